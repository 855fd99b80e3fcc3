"""How a shipped encoder does, untrained further, on rigs, voxels and volumes it never saw."""

from __future__ import annotations

import time
from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np
from _benchmark.problems import problem

import phantoms
import rigs
from rigs import Distortion, Rig
from tomo import VoxelGrid
from tomo.metrics import cosine_distance
from tomo.simulate import simulate
from tomo.solve.stopping import choose_by_held_out_views, solve_as_chosen
from tomo.wernet import CorrectionEncoder, RayWeights, ViewTokens, wernet


@dataclass(frozen=True)
class Case:
    """A scene that no encoder was trained on.

    Attributes
    ----------
    rig, phantom : str
    shape : (int, int, int)
    spacing : (float, float, float)
    shrink : int
        By how much the images of a preset are shrunk, from pixels of a quarter of a millimetre.
    """

    rig: str
    phantom: str
    shape: tuple[int, int, int]
    spacing: tuple[float, float, float]
    shrink: int = 1


CASES = (
    Case("paper33_level", "jet", (15, 70, 15), (1.0, 1.0, 1.0), 4),
    Case("paper33_level", "turbulent", (30, 140, 30), (0.5, 0.5, 0.5), 2),
    Case("paper11_11deg", "jet", (20, 56, 20), (0.75, 1.25, 0.75), 4),
    Case("paper11_33deg", "turbulent", (15, 70, 15), (1.0, 1.0, 1.0)),
    Case("distorted ring", "blobs", (18, 40, 24), (0.8, 1.6, 0.6)),
    Case("distorted ring", "jet", (30, 70, 30), (0.5, 1.0, 0.5)),
    Case("distorted ring", "homogeneous", (15, 70, 15), (1.0, 1.0, 1.0)),
)


@dataclass(frozen=True)
class Transfer:
    """What chords and a frozen encoder give on one case.

    Attributes
    ----------
    case : Case
    footprint : float
        A pixel's size in mean voxel edges.
    chords, frozen, accepted : float
        Cosine distance from the truth: of the classic solve, of the same with the encoder's
        weights, and of what the default method returned.
    held_out_chords, held_out_frozen : float
        Relative residual of left-out views.
    learned : bool
        Whether the method took the encoder's weights.
    chords_seconds, seconds : float
        Of the classic solve, its choices included, and of the method.
    """

    case: Case
    footprint: float
    chords: float
    frozen: float
    accepted: float
    held_out_chords: float
    held_out_frozen: float
    learned: bool
    chords_seconds: float
    seconds: float

    def report(self) -> dict[str, Any]:
        """Return plain values."""
        return asdict(self)


def transfer(encoder: CorrectionEncoder, case: Case, seed: int = 11) -> Transfer:
    """Return how an encoder does on one case, as it is."""
    grid = VoxelGrid(case.shape, case.spacing)
    rig = rig_of(case.rig, case.shrink)
    field = phantoms.create(case.phantom, seed, grid.extent, grid.center)
    scan = simulate(rig, field, grid, supersample=4, refine=2, seed=seed)
    ready = problem(rig, grid, list(scan.images.values()), skip=True, midpoints=True)
    projector, measured = ready.system.projector, ready.measured
    began = time.perf_counter()
    choice = choose_by_held_out_views(projector, measured)
    classic = solve_as_chosen(projector, measured, choice)
    chords_seconds = time.perf_counter() - began

    unit = float(np.sqrt(np.mean(np.square(measured, dtype=np.float64))))
    tokens = ViewTokens(projector.n_views, encoder.channels)
    volume = projector.live.compress(classic.volume)
    weighted = RayWeights(encoder, tokens, volume, unit, False).projector(projector)
    choice_of_weights = choose_by_held_out_views(weighted, measured)
    frozen = solve_as_chosen(weighted, measured, choice_of_weights)

    began = time.perf_counter()
    found = wernet(projector, measured, encoder=encoder, freeze_encoder=True)
    seconds = time.perf_counter() - began
    return Transfer(
        case,
        _footprint(rig, grid),
        cosine_distance(classic.volume, scan.truth),
        cosine_distance(frozen.volume, scan.truth),
        cosine_distance(found.volume, scan.truth),
        choice.held_out_residual,
        choice_of_weights.held_out_residual,
        found.weights is not None,
        chords_seconds,
        seconds,
    )


def rig_of(name: str, shrink: int = 1) -> Rig:
    """Return a preset with smaller images, or a ring of lenses that bend."""
    if name != "distorted ring":
        rig = rigs.preset(name)
        return replace(rig, cameras=tuple(camera.shrunk(shrink) for camera in rig))
    rig = rigs.ring(
        14,
        distance=160.0,
        image_size=(140, 200),
        footprint=0.5,
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
