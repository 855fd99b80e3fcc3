"""The projector without a stored matrix: chord lengths are computed anew at every product."""

from __future__ import annotations

from dataclasses import dataclass

import numba
import numpy as np
from numpy.typing import ArrayLike, NDArray

from tomo._groups import take_groups
from tomo.grid import VoxelGrid
from tomo.rays import Rays
from tomo.trace import slabs
from tomo.trace.box import BoxCrossing, enter_box
from tomo.viewed import ViewedOperator, as_float


@dataclass(frozen=True, eq=False)
class _Course:
    """What the kernels need of rays: where they enter the box, and which pixel they feed."""

    box: BoxCrossing
    weight: NDArray[np.float64]
    pixel_ptr: NDArray[np.int64]

    def rows(self, start: int, stop: int) -> _Course:
        ptr = self.pixel_ptr[start : stop + 1]
        return self._of(slice(int(ptr[0]), int(ptr[-1])), ptr - ptr[0])

    def take(self, pixels: NDArray[np.integer]) -> _Course:
        ptr, rays = take_groups(self.pixel_ptr, pixels)
        return self._of(rays, ptr)

    def _of(self, rays: slice | NDArray[np.int64], pixel_ptr: NDArray[np.int64]) -> _Course:
        box = self.box
        crossing = BoxCrossing(box.position[rays], box.direction[rays], box.length[rays])
        return _Course(crossing, self.weight[rays], pixel_ptr)


class OnTheFlyProjector(ViewedOperator):
    """The same matrix as `tomo.projector.Projector`, never stored: 64 bytes a ray instead.

    Parameters
    ----------
    rays : Rays
    grid : VoxelGrid
    view_ptr : (views + 1,) int, optional
        Where each view's pixels begin; one view when None.

    Notes
    -----
    Chord lengths are exact: float64 set-up relative to the grid, then in the type of the vector
    that is projected. In float32 a position along the ray is good to about 1e-7 of the grid's
    edge; a ray nearly parallel to a face passes it up to as much sooner or later as it is oblique,
    which moves length between the two neighbours. Forward and adjoint compute the same lengths
    (`tomo.trace.slabs`), so that they are each other's transpose to rounding. Results do not
    depend on the number of threads; the adjoint uses at most one thread a layer of voxels along x.
    """

    def __init__(self, rays: Rays, grid: VoxelGrid, view_ptr: ArrayLike | None = None) -> None:
        box = enter_box(rays, grid)
        moving = box.direction.any(axis=1)  # a piece too short to move has no slabs to count
        box = BoxCrossing(box.position, box.direction, np.where(moving, box.length, 0.0))
        course = _Course(box, rays.weight, rays.pixel_ptr)
        self._set(course, grid, view_ptr)

    def _set(self, course: _Course, grid: VoxelGrid, view_ptr: ArrayLike | None) -> None:
        self._course = course
        super().__init__(len(course.pixel_ptr) - 1, grid, view_ptr, np.float32)

    @classmethod
    def _of(
        cls, course: _Course, grid: VoxelGrid, view_ptr: ArrayLike | None
    ) -> OnTheFlyProjector:
        projector = cls.__new__(cls)
        projector._set(course, grid, view_ptr)
        return projector

    def __repr__(self) -> str:
        """Name the sizes."""
        return f"<OnTheFlyProjector: {self.n_views} views, {self.shape[0]} pixels, {self.grid}>"

    @property
    def n_crossings(self) -> int:
        """How many crossings of rays with voxels there are, edges and corners aside."""
        box = self._course.box
        return int((box.planes_between(self.grid.shape) + 1)[box.length > 0].sum())

    def rows(self, start: int, stop: int) -> OnTheFlyProjector:
        """Return the projector of pixels ``start:stop`` as one view; rays are shared."""
        return self._of(self._course.rows(start, stop), self.grid, None)

    def _taken(self, pixels: NDArray, view_ptr: NDArray[np.int64]) -> OnTheFlyProjector:
        return self._of(self._course.take(pixels), self.grid, view_ptr)

    def _rays(self) -> tuple:
        course, box = self._course, self._course.box
        return (
            box.position, box.direction, box.length, course.weight, course.pixel_ptr,
            self.grid.shape,
        )  # fmt: skip

    def _matvec(self, x: NDArray) -> NDArray:
        x = as_float(x.ravel())
        images = np.zeros(self.shape[0], x.dtype)
        slabs.forward(*self._rays(), x, images)
        return images

    def _rmatvec(self, y: NDArray) -> NDArray:
        y = as_float(y.ravel())
        volume = np.zeros(self.shape[1], y.dtype)
        parts = min(numba.get_num_threads(), self.grid.shape[0])
        ranges = np.linspace(0, self.grid.shape[0], parts + 1).astype(np.int64)
        slabs.adjoint(*self._rays(), ranges, y, volume)
        return volume
