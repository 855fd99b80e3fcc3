"""Detection limits in an experimenter's units: of a scene, and of a rig without images."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np

import phantoms
from rigs import Rig
from tomo.grid import VoxelGrid
from tomo.inference.infer import FEWEST_VIEWS, infer
from tomo.inference.limits import DetectionLimits, detection_limits
from tomo.inference.steps import FINER
from tomo.measurement import NoiseModel
from tomo.model import Observation
from tomo.model.effect import Effect
from tomo.pipeline.coarse import RAYS, factor_of
from tomo.scan.downsample import coarser_grid
from tomo.simulation import simulate_images

FLAME = "turbulent"
"""The phantom that stands for a flame of the box's size: it has detail of several sizes."""


@dataclass(frozen=True)
class CameraLimits:
    """The smallest faults of one camera that images would tell."""

    camera: str
    shift: float  # pixels as recorded, across or down, the larger of the two
    roll: float  # degrees
    zoom: float  # a fraction, as the gain
    gain: float
    background: float  # a fraction of the brightest light


@dataclass(frozen=True)
class Limits:
    """The smallest faults that images would tell."""

    cameras: tuple[CameraLimits, ...]
    absorption: float  # smallest optical depth through the box that shows; NaN where not tried
    alike: tuple[tuple[str, str], ...]  # what images do not tell apart

    @classmethod
    def of(cls, found: DetectionLimits, observation: Observation) -> Limits:
        """Return the limits that were found on a coarse copy of some images."""
        sizes, none = found.sizes, np.full(len(found.cameras), math.nan)
        pixel, brightest = observation.pixel, max(observation.brightest, 1e-300)
        shift = [pixel * sizes.get(("pose", way), none) for way in ("right", "down")]
        across = np.array([min(camera.image_size) / 2 for camera in observation.rig])
        rows = zip(
            found.cameras,
            np.maximum(*shift).tolist(),
            np.degrees(sizes.get(("pose", "roll"), none) / across).tolist(),
            (sizes.get(("pose", "zoom"), none) / across).tolist(),
            sizes.get(("gain", "gain"), none).tolist(),
            (sizes.get(("background", "level"), none) / brightest).tolist(),
            strict=True,
        )
        gas = sizes.get(("medium", "depth"), none)
        return cls(tuple(CameraLimits(*row) for row in rows), float(gas[0]), found.alike)

    @property
    def sentence(self) -> str:
        """What is said below a table of the limits."""
        said = "Half of all faults of these sizes would be noticed; smaller ones rarely."
        if math.isfinite(self.absorption):
            depth = f"{self.absorption:.2g}"
            said += f" Gas would be from an optical depth of {depth} across the box."
        if self.alike:
            pairs = "; ".join(f"{one} with {other}" for one, other in self.alike)
            said += f" Not told apart: {pairs}."
        return said

    def report(self) -> dict[str, Any]:
        """Return the limits as plain data, by camera."""
        figures = [asdict(one) for one in self.cameras]
        cameras = {one.pop("camera"): one for one in figures}
        alike = [list(pair) for pair in self.alike]
        return {"cameras": cameras, "absorption": self.absorption, "alike": alike}


def limits_of_rig(
    rig: Rig, grid: VoxelGrid, effects: Sequence[Effect], noise: float, seed: int = 0
) -> Limits:
    """Return what a rig would tell of its own faults from images of a flame of the grid's size.

    ``effects`` are those looked for, see `tomo.pipeline.infer.effects_of`; ``noise`` is the
    standard deviation of a pixel as a fraction of the brightest.
    """
    if len(rig) < FEWEST_VIEWS:
        raise ValueError(
            f"detection limits: found {len(rig)} cameras, expected at least {FEWEST_VIEWS}: "
            "whatever is wrong, some volume reproduces two images"
        )
    factor = factor_of(rig, grid)
    seen = replace(rig, cameras=tuple(camera.shrunk(factor) for camera in rig))
    coarse = coarser_grid(grid, factor)
    flame = phantoms.create(FLAME, seed, grid.extent, grid.center)
    spread = noise / factor
    made = simulate_images(
        seen, flame, coarse, supersample=RAYS, refine=FINER, noise=spread, seed=seed
    )
    images = tuple(made.images.values())
    read = spread * max(float(image.max()) for image in images)
    observation = Observation(
        seen,
        images,
        tuple(np.ones(image.shape, bool) for image in images),
        (NoiseModel(read, 0.0),) * len(images),
        coarse,
        supersample=RAYS,
        pixel=factor,
    )
    found = infer([observation], effects)
    return Limits.of(detection_limits(found, draw_null=True), observation)
