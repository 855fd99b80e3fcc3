"""The projection without a stored matrix, on a device: lengths are computed at every product."""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import Any, cast

import numpy as np
from numpy.typing import DTypeLike, NDArray

from tomo.operators.absorption import Absorption, depth_around, extinction_on_grid
from tomo.operators.composition import Change
from tomo.operators.gpu.device import NOTHING, TOGETHER, Device, together
from tomo.operators.gpu.device_operator import DeviceOperator
from tomo.operators.gpu.rays import DeviceRays, copied_rays, slab_of, voxels_of
from tomo.operators.on_the_fly import AttenuatedProjector, OnTheFlyProjector
from tomo.operators.on_the_fly.running_sums import adjoint_with_nonfinite

BITS = 62
"""Bits of the largest sum of whole numbers: more leave no room for the sign and the roundings."""

STRANDS = 1 << 14
"""Threads a column that look for the largest pixel: fewer read slowly, more wait to compare."""


class DeviceProjector(DeviceOperator):
    """The matrix of lengths of `OnTheFlyProjector`, computed on a device at every product.

    The rays are copied to the device, 64 bytes each; `tomo.operators.gpu` has the method. A
    product takes the memory of a volume: of 64-bit integers for each of up to four columns
    (adjoint), of values where not all voxels are active (forward). A voxel that is not finite
    reaches the rays that cross it; a pixel, all voxels that it sees.

    The whole numbers count multiples of ``1 / u``, ``u`` the largest power of two with
    ``max|y| max_v (A^T 1)_v u < 2^62``: sums are exact, a piece is rounded to half of one.
    """

    def __init__(
        self,
        projector: OnTheFlyProjector,
        device: Device,
        shared: DeviceRays | None = None,
        spans: tuple[NDArray[np.int64], NDArray[np.int64]] | None = None,
        seen: tuple[Any, ...] | None = None,
    ) -> None:
        most = 0.0
        if shared is None or spans is None:
            rays, is_first, ptr, most = copied_rays(projector, device)
            voxels = voxels_of(projector.grid, projector.active, device)
            shared, spans = DeviceRays(rays, is_first, *voxels, abs(most)), (ptr[:-1], ptr[1:])
        self.flying, self.device, self._shared = projector, device, shared
        self._starts, self._stops = spans  # pixel p has the rays starts[p]:stops[p]
        seen = seen or tuple(map(device.array, spans))
        self._seen = np.int64(len(spans[0])), *seen, shared.rays, shared.grid
        super().__init__(
            len(spans[0]), projector.grid, projector.view_ptr, np.float32, projector.active
        )
        if most > 0:  # the sum itself, from a scale by its bound
            self._shared = replace(shared, most=1.001 * self._largest_sum)

    @classmethod
    def in_slabs(
        cls, projector: OnTheFlyProjector, device: Device, cuts: Sequence[int]
    ) -> list[DeviceProjector]:
        """Return the projectors of slabs of the grid, which share the rays on the device.

        ``cuts`` are the first plane of each slab along x, and the number of planes. Images of all
        slabs add up to the grid's, their adjoints one after another are its adjoint, but for their
        scales.
        """
        rays, is_first, ptr, most = copied_rays(projector, device)
        found: list[DeviceProjector] = []
        for start, stop in itertools.pairwise(cuts):
            active = slab_of(projector.active, start, stop)
            voxels = voxels_of(projector.grid, active, device, range(start, stop))
            shared = DeviceRays(rays, is_first, *voxels, abs(most))
            seen = found[0]._seen[1:3] if found else None
            spans = ptr[:-1], ptr[1:]
            found.append(cls(projector.through(active), device, shared, spans, seen))
        if most > 0:
            most = 1.001 * max(slab._largest_sum for slab in found)
            for slab in found:
                slab._shared = replace(slab._shared, most=most)
        return found

    def __repr__(self) -> str:
        """Name the sizes and the device."""
        return (
            f"<DeviceProjector: {self.n_views} views, {self.shape[0]} pixels, {self.grid}, "
            f"{self.device.name}>"
        )

    @property
    def n_segments(self) -> int:
        """Number of segments of rays in voxels; passing an edge counts as two face crossings."""
        return self.flying.n_segments

    @property
    def on_cpu(self) -> OnTheFlyProjector | AttenuatedProjector:
        """The operator of the same rays on the CPU."""
        if not self._shared.absorption:
            return self.flying
        return AttenuatedProjector(self.flying, *self._shared.absorption)

    def with_rays(self, change: Change) -> DeviceProjector:
        """Return the operator of other rays: ``change`` takes and returns those of the CPU.

        It is given those through transparent gas; if it returns the same, those on the device
        serve.
        """
        found = change(self.flying)
        if isinstance(found, AttenuatedProjector) and found.rays is self.flying:
            return self.with_absorption(found.absorption, found.emission)
        if found is self.flying:
            return self.without_absorption
        return DeviceProjector(cast("OnTheFlyProjector", found), self.device)

    @property
    def without_absorption(self) -> DeviceProjector:
        """The operator of the same rays through transparent gas."""
        shared = replace(self._shared, gas=(), absorption=())
        return DeviceProjector(self.flying, self.device, shared, (self._starts, self._stops))

    def with_absorption(
        self, absorption: Absorption, emission: NDArray[np.floating] | None = None
    ) -> DeviceProjector:
        """Return the operator of the same rays through gas that absorbs.

        ``emission`` (unknowns,) is needed where ``absorption.emission`` is not 0.
        """
        extinction = np.zeros(self.grid.size)
        outside: Any = NOTHING
        if absorption.emission != 0 and emission is not None:
            extinction += absorption.emission * self.active.expand(np.ravel(emission))
        if absorption.extinction is not None:
            extinction += extinction_on_grid(absorption.extinction, self.grid)
            parts = self.flying.some_rays()
            depths = [depth_around(absorption.extinction, rays, self.grid) for _, _, rays in parts]
            around = [depth for depth in depths if depth is not None]
            if around:
                outside = self.device.array(np.concatenate(around))
        gas = (
            np.float64(absorption.medium), self.device.array(extinction), outside,
            self._shared.is_first,
        )  # fmt: skip
        shared = replace(self._shared, gas=gas, absorption=(absorption, emission))
        return DeviceProjector(self.flying, self.device, shared, (self._starts, self._stops))

    def rows(self, start: int, stop: int) -> DeviceProjector:
        """Return the projector of pixels ``start:stop`` as one view; rays are shared."""
        return self._part(self.flying.rows(start, stop), slice(start, stop))

    def _taken(self, pixels: NDArray[np.integer], view_ptr: NDArray[np.int64]) -> DeviceProjector:
        return self._part(self.flying._taken(pixels, view_ptr), pixels)

    def _part(
        self, flying: OnTheFlyProjector, some: slice | NDArray[np.integer]
    ) -> DeviceProjector:
        spans = self._starts[some], self._stops[some]
        return DeviceProjector(flying, self.device, self._shared, spans)

    def forward(self, x: Any) -> Any:
        """Return the images ``(pixels, columns)`` of unknowns ``(unknowns, columns)``."""
        columns, volume = x.shape[1], x
        if not self.active.all:
            volume = self.device.zeros((self.grid.size, columns), x.dtype)
            numbers = np.int64(self.shape[1]), np.int64(columns)
            self._run("spread", x.dtype, x.size, *numbers, self._shared.index, x, volume)
        images = self.device.zeros((self.shape[0], columns), x.dtype)
        for first, some in self._together(columns):
            of = volume, images, np.int64(columns), np.int64(first)
            self._walk("forward", some, x.dtype, *of)
        return images

    def adjoint(self, y: Any) -> Any:
        """Return the unknowns ``(unknowns, columns)`` of images ``(pixels, columns)``."""
        columns = y.shape[1]
        largest = self._largest(y)
        if not np.isfinite(largest).all():
            return self._adjoint_of_nonfinite(y)
        values = self.device.zeros((self.shape[1], columns), y.dtype)
        per_unit = self.device.array(_per_unit(largest * self._shared.most))
        for first, some in self._together(columns):
            sums = self.device.zeros((self.grid.size * some,), np.uint64)
            of = per_unit, sums, np.int64(columns), np.int64(first)
            self._walk("adjoint", some, y.dtype, self._shared.active, y, *of)
            self._run(
                "collect", y.dtype, self.shape[1] * some, np.int64(self.shape[1]), np.int64(some),
                self._shared.index, sums, per_unit, values, np.int64(columns), np.int64(first),
            )  # fmt: skip
        return values

    def _together(self, columns: int) -> Iterator[tuple[int, int]]:
        """Iterate over the columns that share a walk: the first, and how many."""
        return together(columns, 1 if self._shared.gas else TOGETHER)

    def _walk(self, product: str, columns: int, values: DTypeLike, *of: Any) -> None:
        """Launch a product, one thread a pixel."""
        name = f"dimmed_{product}" if self._shared.gas else f"{product}_{columns}"
        self._run(name, values, self.shape[0], *self._seen, *of, *self._shared.gas)

    def _run(self, kernel: str, values: DTypeLike, threads: int, *arguments: Any) -> None:
        self.device.launch(kernel, values, threads, *arguments)

    def _largest(self, y: Any) -> NDArray[np.float64]:
        """Return the largest magnitude of each column, ``(columns,)``; NaN is the largest."""
        rows, columns = y.shape
        found = self.device.zeros((columns,), np.uint64)
        numbers = np.int64(rows), np.int64(columns), np.int64(STRANDS)
        self._run("largest", y.dtype, columns * STRANDS, *numbers, y, found)
        return self.device.host(found).view(np.float64)

    def _adjoint_of_nonfinite(self, y: Any) -> Any:
        """Return the adjoint of images of which some pixels are not finite; rare, and slow."""

        def one(pixels: NDArray) -> NDArray:
            return self.device.host(self.adjoint(self.device.array(pixels[:, None]))).ravel()

        images = self.device.host(y)
        columns = [adjoint_with_nonfinite(one, each, np.isfinite(each)) for each in images.T]
        return self.device.array(np.ascontiguousarray(np.stack(columns, axis=1)))

    @property
    def _largest_sum(self) -> float:
        """The largest sum of a column in single precision, by the scale that there is."""
        ones = self.device.array(np.ones((self.shape[0], 1), np.float32))
        return float(self.device.host(self.adjoint(ones)).max(initial=0.0))


def _per_unit(most: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the power of two for each bound of sums, ``(columns,)``; 1 where all are zero."""
    exponents = np.minimum(BITS - np.frexp(most)[1], 1023)
    return np.where(most > 0, np.ldexp(1.0, exponents), 1.0)
