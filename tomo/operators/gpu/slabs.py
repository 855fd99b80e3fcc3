"""A volume that does not fit on a device, cut into slabs that do, one there at a time."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from tomo.operators.gpu.device import Device
from tomo.operators.gpu.projector import DeviceProjector
from tomo.operators.on_the_fly import OnTheFlyProjector
from tomo.operators.operator import ProjectionOperator, as_float


class DeviceSlabs(ProjectionOperator):
    """The matrix of lengths of `OnTheFlyProjector`, computed on a device slab by slab.

    Parameters
    ----------
    count : int
        How many slabs the grid is cut into, along x.

    Notes
    -----
    The rays stay on the device; of volumes a slab is there at a time. They are NumPy's arrays.
    ``A x = sum_s A_s x_s``, and ``A^T y`` are the ``A_s^T y`` one after another. A ray in the
    face between two slabs belongs to the upper one, as between voxels. Crossings that a slab's
    own entry rounds apart from the whole grid's are off by some 1e-15 of a voxel.
    """

    def __init__(self, projector: OnTheFlyProjector, device: Device, count: int) -> None:
        planes = projector.grid.shape[0]
        cuts = [planes * number // count for number in range(count + 1)]
        self._set(projector, DeviceProjector.in_slabs(projector, device, cuts))

    def _set(self, projector: OnTheFlyProjector, slabs: Sequence[DeviceProjector]) -> None:
        self.on_cpu, self.slabs, self.device = projector, tuple(slabs), slabs[0].device
        self._ptr = np.cumsum([0] + [slab.shape[1] for slab in slabs])
        super().__init__(
            projector.shape[0], projector.grid, projector.view_ptr, np.float32, projector.active
        )

    def __repr__(self) -> str:
        """Name the sizes and the device."""
        return f"<DeviceSlabs: {self.shape[0]} pixels, {self.grid}, {len(self.slabs)} slabs>"

    @property
    def n_segments(self) -> int:
        """Number of segments of rays in voxels; passing an edge counts as two face crossings."""
        return self.on_cpu.n_segments

    @property
    def without_absorption(self) -> OnTheFlyProjector:
        """The operator of the CPU: light that gas absorbs is not computed slab by slab."""
        return self.on_cpu

    def rows(self, start: int, stop: int) -> Self:
        """Return the projector of pixels ``start:stop`` as one view; rays are shared."""
        return self._part(lambda one: one.rows(start, stop))

    def _taken(self, pixels: NDArray[np.integer], view_ptr: NDArray[np.int64]) -> Self:
        return self._part(lambda one: one._taken(pixels, view_ptr))

    def _part(self, take: Callable[[Any], Any]) -> Self:
        part = type(self).__new__(type(self))
        part._set(take(self.on_cpu), [take(slab) for slab in self.slabs])
        return part

    def _matvec(self, x: NDArray) -> NDArray:
        return self._matmat(x.reshape(-1, 1)).ravel()

    def _rmatvec(self, y: NDArray) -> NDArray:
        return self._rmatmat(y.reshape(-1, 1)).ravel()

    def _matmat(self, x: NDArray) -> NDArray:
        x = as_float(x)
        images = np.zeros((self.shape[0], x.shape[1]), x.dtype)
        for slab, start, stop in zip(self.slabs, self._ptr[:-1], self._ptr[1:], strict=True):
            images += self.device.host(slab.forward(self.device.array(x[start:stop])))
        return images

    def _rmatmat(self, y: NDArray) -> NDArray:
        there = self.device.array(as_float(y))
        return np.concatenate([self.device.host(slab.adjoint(there)) for slab in self.slabs])
