"""The stages from the frames that were read to weighted equations: of a still, or of a film.

A still is a film of one frame. Pixels, and which cameras take part, are settled from the mean of
the frames; effects of cameras and gas, poses, and what is carved from the frames themselves.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

from rigs.progress import Progress
from tomo.grid import VoxelGrid
from tomo.operators import LinearSystem
from tomo.pipeline.build import WeightedSystem, build
from tomo.pipeline.evaluate import trace_apart
from tomo.pipeline.infer import infer_effects
from tomo.pipeline.load import LoadedScan
from tomo.pipeline.options import Options
from tomo.pipeline.register import Registered, register
from tomo.pipeline.screen import FrameImages, ScreenedScan, images_of, mean_of_frames, screen
from tomo.pipeline.stage import Record
from tomo.pipeline.trace import TracedScan, trace_views
from tomo.scan import Scan

INFERENCE = "cameras and gas"
"""The stage that infers what is wrong with them."""


@dataclass(frozen=True, eq=False)
class Prepared:
    """What is settled before a volume is solved for."""

    screened: ScreenedScan
    frames: tuple[FrameImages, ...]
    registered: Registered
    traced: TracedScan
    built: WeightedSystem
    apart: LinearSystem | None

    @property
    def records(self) -> dict[str, Record]:
        """The seconds and warnings of each stage."""
        return {
            "screen": self.screened.record,
            "register": self.registered.record,
            "trace": self.traced.record,
            "build": self.built.record,
        }


def prepare(
    scan: Scan,
    grid: VoxelGrid,
    options: Options,
    loaded: Sequence[LoadedScan],
    cameras: Sequence[str] = (),
    stage: Callable[[str], Progress | None] = lambda where: None,
) -> Prepared:
    """Screen, infer, register, trace and build: of one frame, or of the key frames of a film."""
    stage("pixels")
    screened = screen(mean_of_frames(loaded), options.hold_out, look=options.screen)
    step = stage(INFERENCE)
    screened = infer_effects(screened, scan, grid, options, loaded, cameras, step)
    stage("empty voxels")
    frames = [images_of(one, screened) for one in loaded]
    registered = register(screened, frames, grid, options)
    traced = trace_views(screened, registered, grid, options, stage("tracing"))
    apart = trace_apart(screened, traced.system, options)
    stage("basis and weights")
    built = build(screened, traced, options)
    return Prepared(screened, tuple(frames), registered, traced, built, apart)
