"""Geometry: tracers and projectors where coordinates, sizes and rays are at their worst.

Bounds are roundings of float64: of the farthest coordinate in voxels where that is what is known
of a ray, of the result where everything is measured from the grid.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator

import numpy as np
import scipy.sparse

from _stress import geometry_scenes as scenes
from _stress.geometry_large import large_rows
from _stress.geometry_lenses import lens_rows
from _stress.geometry_motion import motion_rows
from _stress.geometry_scenes import TILTED, Case, roundings_apart
from _stress.row import Progress, Row, Size, worst_of
from tomo import Projector, dot_test
from tomo.operators.on_the_fly.projector import OnTheFlyProjector
from tomo.trace import TRACERS, trace

Cases = Callable[[int, np.random.Generator], Iterator[Case]]

KINDS: dict[str, tuple[Cases, str]] = {
    "Cameras far away": (scenes.distances, "inside the grid to 1e8 voxels away"),
    "Voxel sizes": (scenes.voxel_sizes, "1e-9 to 1e9 units"),
    "Grids off the origin": (scenes.far_grids, "1e3 to 1e7 voxels"),
    "Flat and long voxels": (scenes.flat_voxels, "1000 to 1, along every axis"),
    "Grids one voxel thin": (scenes.thin_grids, "along one, two and all axes"),
    "Rays along faces, edges and axes": (scenes.special_rays, "subnormal parts among them"),
}

ROUNDINGS = 8.0
"""Of a coordinate, by which two tracers may place a crossing differently: each rounds the origin,
the step to the box and the plane, and an oblique ray moves 1 / 0.05 voxels along for one across.
"""


def rows(size: Size, progress: Progress) -> Iterator[Row]:
    """Yield the area's rows."""
    parts = len(KINDS) + 3
    for done, (name, (cases, over)) in enumerate(KINDS.items()):
        progress(done, parts, name)
        random = np.random.default_rng([size.seed, done])
        found = list(cases(150 if size.quick else 3000, random))
        yield from _tracer_rows(name, over, found)
    for done, (name, part) in enumerate(
        (("lenses", lens_rows), ("motion", motion_rows), ("large grids", large_rows))
    ):
        progress(len(KINDS) + done, parts, name)
        yield from part(size)


def _tracer_rows(name: str, over: str, cases: list[Case]) -> Iterator[Row]:
    measured = [_Measured(case) for case in cases]

    def worst(figures: Callable[[_Measured], Iterator[float]]) -> tuple[float, str]:
        return worst_of((one.case.name, figure) for one in measured for figure in figures(one))

    figure, where = worst(_Measured.chords)
    yield Row(
        f"{name}: sums of chords against the ray's length in the box", over, figure, 4.0,
        "roundings of the farthest coordinate", note=where,
    )  # fmt: skip
    figure, where = worst(_Measured.voxels)
    if any(TILTED in case.name for case in cases):
        where += "; without rays hardly tilted from an edge: rounding says on which side they run"
    yield Row(
        f"{name}: tracers and projectors against the float64 twin", over, figure, ROUNDINGS,
        "roundings of the farthest coordinate, in voxels", note=where,
    )  # fmt: skip
    for kind, bound in ((np.float64, 1e-12), (np.float32, 1e-6)):
        figure, where = worst(lambda one, kind=kind: one.dot_tests(kind))
        yield Row(
            f"{name}: back-projection against the transpose, {kind.__name__}", over, figure, bound,
            "relative", note=where,
        )  # fmt: skip


class _Measured:
    """What all tracers and both projectors make of one case."""

    def __init__(self, case: Case) -> None:
        self.case = case
        rays, grid = case.rays, case.grid
        self.stored = {
            name: Projector(trace(rays, grid, name, dtype=np.float64), grid) for name in TRACERS
        }
        self.flying = OnTheFlyProjector(rays, grid)
        self.single = Projector(trace(rays, grid), grid)

    def chords(self) -> Iterator[float]:
        """How far each one's sums of chords are from the analytic lengths."""
        for one in (*self.stored.values(), self.flying):
            yield roundings_apart(self.case, one.row_sums)

    def voxels(self) -> Iterator[float]:
        """How far each is from the reference, voxel by voxel, forward and back, in roundings.

        Rays hardly tilted from a face change sides where rounding makes them: they are left out.
        """
        if TILTED in self.case.name:
            return
        # what a position's rounding moves a crossing by, along the ray and in its own length
        reference = self.stored["reference"]
        unit = self.case.rounding / scenes.STEEPEST
        longest = max(float(_matrix(reference).max()), 1e-300)
        random = np.random.default_rng(0)
        x, y = random.random(reference.shape[1]), random.random(reference.shape[0])
        images, volume = reference @ x, reference.T @ y
        for name in ("march", "raycast"):
            difference = abs(_matrix(self.stored[name]) - _matrix(reference)).max()
            yield float(difference) / longest / unit
        for one in (self.stored["march"], self.flying):
            yield float(np.abs(one @ x - images).max()) / max(images.max(), 1e-300) / unit
            yield float(np.abs(one.T @ y - volume).max()) / max(volume.max(), 1e-300) / unit

    def dot_tests(self, kind: type) -> Iterator[float]:
        """How far each one's adjoint is from its transpose."""
        for one in (self.single, self.flying):
            yield dot_test(one, 1, kind)


def _matrix(projector: Projector) -> scipy.sparse.csr_array:
    """Return a projector's matrix, pieces in one voxel summed."""
    matrix = projector.to_scipy().copy()
    matrix.sum_duplicates()
    return matrix
