"""How a shipped encoder does, untrained further, on rigs, voxels and volumes it never saw."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import asdict, dataclass, replace
from typing import Any, TypeVar

import numpy as np
from _benchmark.problems import problem

import phantoms
import rigs
from phantoms.field import Field
from rigs import Distortion, Rig
from tomo import Reconstruction, VoxelGrid
from tomo._basis import better_of
from tomo._run import averages_of
from tomo.metrics import cosine_distance
from tomo.simulate import simulate
from tomo.solve.stopping import Choice, choose_by_held_out_views, solve_as_chosen
from tomo.wernet import CorrectionEncoder, RayWeights, ViewTokens, wernet


@dataclass(frozen=True)
class Case:
    """A scene that no encoder was trained on.

    Attributes
    ----------
    rig : str
        See `rig_of`.
    phantom : str
        One of `phantoms.names`, or "wide blobs", twice as wide.
    shape : (int, int, int)
    spacing : (float, float, float)
    shrink : int
        By how much the images of a preset are shrunk, from pixels of a quarter of a millimetre.
    seed : int
        Of the phantom.
    """

    rig: str
    phantom: str
    shape: tuple[int, int, int]
    spacing: tuple[float, float, float]
    shrink: int = 1
    seed: int = 11


RESOLVED = tuple(
    Case(rig, phantom, shape, spacing, seed=seed)
    for rig, phantom, shape, spacing in (
        ("paper33_pitch", "jet", (30, 140, 30), (0.5, 0.5, 0.5)),
        ("paper33_pitch", "turbulent", (30, 140, 30), (0.5, 0.5, 0.5)),
        ("14 of paper33_pitch", "jet", (30, 140, 30), (0.5, 0.5, 0.5)),
        ("14 of paper33_pitch", "turbulent", (30, 140, 30), (0.5, 0.5, 0.5)),
        ("fine distorted ring", "wide blobs", (40, 75, 53), (0.4, 0.6, 0.3)),
    )
    for seed in (1, 2, 3, 5)
)
"""Voxels as fine as the phantoms ask for, which the rigs resolve."""

COARSE = (
    Case("paper33_level", "jet", (15, 70, 15), (1.0, 1.0, 1.0), 4),
    Case("paper33_level", "turbulent", (30, 140, 30), (0.5, 0.5, 0.5), 2),
    Case("paper11_11deg", "jet", (20, 56, 20), (0.75, 1.25, 0.75), 4),
    Case("paper11_33deg", "turbulent", (15, 70, 15), (1.0, 1.0, 1.0)),
    Case("distorted ring", "blobs", (18, 40, 24), (0.8, 1.6, 0.6)),
    Case("distorted ring", "jet", (30, 70, 30), (0.5, 1.0, 0.5)),
    Case("distorted ring", "homogeneous", (15, 70, 15), (1.0, 1.0, 1.0)),
)
"""Voxels or rigs too coarse for the phantoms, chord lengths or not."""

CASES = RESOLVED + COARSE


@dataclass(frozen=True)
class Transfer:
    """What chords and a frozen encoder give on one case.

    Attributes
    ----------
    case : Case
    footprint : float
        A pixel's size in mean voxel edges.
    basis : str
        Boxes or splines, whichever predicts left-out views better.
    chords, frozen, accepted : float
        Cosine distance from the truth: of the classic solve, of the same with the encoder's
        weights, and of what the default method returned.
    held_out_chords, held_out_frozen : float
        Relative residual of left-out views.
    learned : bool
        Whether the method took the encoder's weights.
    chords_seconds, seconds : float
        Of the classic solve, its choices included, and of the method, which holds it.
    chords_processor_seconds, processor_seconds : float
        The same, of all cores together: what other work on the machine does not change.
    """

    case: Case
    footprint: float
    basis: str
    chords: float
    frozen: float
    accepted: float
    held_out_chords: float
    held_out_frozen: float
    learned: bool
    chords_seconds: float
    seconds: float
    chords_processor_seconds: float
    processor_seconds: float

    def report(self) -> dict[str, Any]:
        """Return plain values."""
        return asdict(self)


def transfer(encoder: CorrectionEncoder, case: Case) -> Transfer:
    """Return how an encoder does on one case, as it is."""
    grid = VoxelGrid(case.shape, case.spacing)
    rig = rig_of(case.rig, case.shrink)
    field = _field(case.phantom, case.seed, grid)
    scan = simulate(rig, field, grid, supersample=4, refine=2, seed=case.seed)
    ready = problem(rig, grid, list(scan.images.values()), skip=True, midpoints=True)
    measured = ready.measured
    system, basis = better_of(ready.system, measured)
    projector = system.projector

    def distance(found: Reconstruction) -> float:
        volume = averages_of(projector, projector.live.compress(found.volume))
        return cosine_distance(volume, scan.truth)

    def classic() -> tuple[Choice, Reconstruction]:
        choice = choose_by_held_out_views(projector, measured)
        return choice, solve_as_chosen(projector, measured, choice)

    def method() -> Reconstruction:
        return wernet(projector, measured, encoder=encoder, freeze_encoder=True)

    (choice, chords), *chords_seconds = _timed(classic)
    found, *seconds = _timed(method)
    unit = float(np.sqrt(np.mean(np.square(measured, dtype=np.float64))))
    tokens = ViewTokens(projector.n_views, encoder.channels)
    volume = projector.live.compress(chords.volume)
    weighted = RayWeights(encoder, tokens, volume, unit, False).projector(projector)
    frozen = solve_as_chosen(weighted, measured, choice)
    residuals = found.settings["held_out_residual"]
    return Transfer(
        case,
        _footprint(rig, grid),
        basis.name,
        distance(chords),
        distance(frozen),
        distance(found),
        residuals["chords"],
        residuals["learned"],
        found.weights is not None,
        chords_seconds[0],
        seconds[0],
        chords_seconds[1],
        seconds[1],
    )


def _field(name: str, seed: int, grid: VoxelGrid) -> Field:
    field = phantoms.create(name.removeprefix("wide "), seed, grid.extent, grid.center)
    if not name.startswith("wide "):
        return field
    return phantoms.GaussianBlobs(field.centers, 2 * np.asarray(field.widths), field.amplitudes)


Result = TypeVar("Result")


def _timed(run: Callable[[], Result]) -> tuple[Result, float, float]:
    """Return what ``run`` returns, and the seconds by the clock and of the processor."""
    began, worked = time.perf_counter(), time.process_time()
    found = run()
    return found, time.perf_counter() - began, time.process_time() - worked


def rig_of(name: str, shrink: int = 1) -> Rig:
    """Return a preset with smaller images, some cameras of one, or a ring of lenses that bend.

    Parameters
    ----------
    name : str
        A preset, "N of" a preset, "distorted ring", or "fine distorted ring" of finer pixels.
    shrink : int
        Of a preset's images.
    """
    if name.endswith("distorted ring"):
        return _distorted_ring(2 if name.startswith("fine") else 1)
    count, _, preset = name.rpartition(" of ")
    rig = rigs.preset(preset)
    cameras = [camera.shrunk(shrink) for camera in rig]
    number = int(count) if count else len(cameras)
    some = tuple(cameras[k * len(cameras) // number] for k in range(number))
    return replace(rig, cameras=some)


def _distorted_ring(finer: int) -> Rig:
    """Return 14 cameras whose lenses bend, their pixels half a unit over ``finer``."""
    rig = rigs.ring(
        14,
        distance=160.0,
        image_size=(140 * finer, 200 * finer),
        footprint=0.5 / finer,
        pitch_degrees=[15.0, -10.0] * 7,
    )
    lens = Distortion("brown", (-0.15, 0.03, 0.001, -0.002))
    return replace(rig, cameras=tuple(replace(camera, distortion=lens) for camera in rig))


def _footprint(rig: Rig, grid: VoxelGrid) -> float:
    """Return the middle camera's pixel at the grid's middle, in mean voxel edges."""
    camera = rig[len(rig) // 2]
    distance = float(np.linalg.norm(camera.position - np.asarray(grid.center)))
    edge = float(np.prod(grid.spacing)) ** (1 / 3)
    return distance / float(camera.camera_matrix[0, 0]) / edge
