"""The projection with a stored matrix, on a device: rows, and the rows of the transpose."""

from __future__ import annotations

from functools import cached_property
from typing import Any, cast

import numpy as np
from numpy.typing import NDArray

from tomo.operators.composition import Change
from tomo.operators.gpu.device import NOTHING, Device, together
from tomo.operators.gpu.device_operator import DeviceOperator
from tomo.operators.stored import Projector
from tomo.trace import Segments

LANES = 8
"""Threads that add up a row: as the kernels are written."""


class _Rows:
    """Rows of a sparse matrix on a device, and their products with columns."""

    def __init__(self, matrix: Any, device: Device) -> None:
        """Copy a matrix in scipy's CSR."""
        self.device, self.count = device, matrix.shape[0]
        ptr = matrix.indptr.astype(np.int64)
        entries = device.array(matrix.data)
        single = matrix.data.dtype == np.float32
        self._held = (
            np.int64(self.count), device.array(ptr[:-1]), device.array(ptr[1:]),
            device.array(matrix.indices.astype(np.uint32)),
            entries if single else NOTHING, NOTHING if single else entries,
        )  # fmt: skip

    def __matmul__(self, x: Any) -> Any:
        """Return the products ``(rows, columns)`` with ``x`` (unknowns, columns)."""
        columns, launch = x.shape[1], self.device.launch
        values = self.device.zeros((self.count, columns), x.dtype)
        for first, some in together(columns):
            parts = self.device.zeros((self.count * LANES * some,), np.float64)
            at, rows = (np.int64(columns), np.int64(first)), self._held[0]
            launch(f"row_parts_{some}", x.dtype, self.count * LANES, *self._held, x, *at, parts)
            of = rows, np.int64(some), parts, values
            launch("row_totals", x.dtype, self.count * some, *of, *at)
        return values


class DeviceMatrix(DeviceOperator):
    """The stored matrix of `Projector` on a device, and its transpose.

    Parameters
    ----------
    projector : Projector
        Whose entries are copied to the device, twice: once row by row for ``A @ x``, and at the
        first ``A.T @ y`` column by column. 8 bytes each in float32.

    Notes
    -----
    Every row is added up in double precision in an order of its own: runs repeat to the bit.
    Operators of some of the pixels copy theirs.
    """

    is_stored = True

    def __init__(self, projector: Projector, device: Device) -> None:
        self.stored, self.device = projector, device
        super().__init__(
            projector.shape[0], projector.grid, projector.view_ptr, projector.dtype,
            projector.active,
        )  # fmt: skip

    def __repr__(self) -> str:
        """Name the sizes and the device."""
        return (
            f"<DeviceMatrix: {self.n_views} views, {self.shape[0]} pixels, {self.grid}, "
            f"{self.device.name}>"
        )

    @property
    def on_cpu(self) -> Projector:
        """The stored matrix."""
        return self.stored

    @property
    def n_segments(self) -> int:
        """Number of stored entries."""
        return self.stored.n_segments

    @property
    def segments(self) -> Segments:
        """The entries as segments, on the CPU."""
        return self.stored.segments

    @cached_property
    def _rows(self) -> _Rows:
        return _Rows(self.stored.to_scipy(), self.device)

    @cached_property
    def _columns(self) -> _Rows:
        return _Rows(self.stored.to_scipy().T.tocsr(), self.device)

    def forward(self, x: Any) -> Any:
        """Return the images ``(pixels, columns)`` of unknowns ``(unknowns, columns)``."""
        return self._rows @ x

    def adjoint(self, y: Any) -> Any:
        """Return the unknowns ``(unknowns, columns)`` of images ``(pixels, columns)``."""
        return self._columns @ y

    def rows(self, start: int, stop: int) -> DeviceMatrix:
        """Return the operator of pixels ``start:stop`` as one view."""
        return DeviceMatrix(self.stored.rows(start, stop), self.device)

    def _taken(self, pixels: NDArray[np.integer], view_ptr: NDArray[np.int64]) -> DeviceMatrix:
        return DeviceMatrix(self.stored._taken(pixels, view_ptr), self.device)

    def with_rays(self, change: Change) -> DeviceMatrix:
        """Return the operator of other rays: ``change`` takes and returns those of the CPU."""
        return DeviceMatrix(cast("Projector", change(self.stored)), self.device)

    def of_unknowns(self, kept: NDArray[np.bool_]) -> DeviceMatrix:
        """Return the operator of some of the unknowns, ``kept`` (unknowns,) bool; a copy."""
        return DeviceMatrix(self.stored.of_unknowns(kept), self.device)

    def with_lengths(self, length: NDArray[np.floating]) -> DeviceMatrix:
        """Return the operator with ``length`` (segments,), of either sign, instead of its own."""
        return DeviceMatrix(self.stored.with_lengths(length), self.device)
