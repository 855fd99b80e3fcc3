"""What operators on a device share: arguments of any library, and columns."""

from __future__ import annotations

import sys
from abc import abstractmethod
from collections.abc import Callable
from contextlib import AbstractContextManager
from functools import cached_property
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from tomo._compute.arrays import host, is_numpy
from tomo.operators.gpu.device import Device
from tomo.operators.operator import ArrayProducts, ProjectionOperator, as_float

Apply = Callable[[Any], Any]
"""Takes values ``(rows, columns)`` on the device to others there."""


class DeviceOperator(ArrayProducts):
    """A projection operator whose products are computed on a device.

    Subclasses set ``device`` and compute `forward` and `adjoint` of columns there.
    """

    device: Device

    @abstractmethod
    def forward(self, x: Any) -> Any:
        """Return the images ``(pixels, columns)`` of unknowns ``(unknowns, columns)``."""

    @abstractmethod
    def adjoint(self, y: Any) -> Any:
        """Return the unknowns ``(unknowns, columns)`` of images ``(pixels, columns)``."""

    @property
    @abstractmethod
    def on_cpu(self) -> ProjectionOperator:
        """The operator of the CPU that was taken to the device."""

    def takes(self, values: Any) -> bool:
        """Return whether an argument is another library's array on the device: it stays there."""
        return not is_numpy(values) and self.device.holds(values)

    def array(self, values: Any) -> Any:
        """Return values on the device: those that are there as they are, a copy of others."""
        return values if self.takes(values) else self.device.array(host(values))

    @cached_property
    def _views(self) -> dict[int, Self]:
        return {}

    def view(self, number: int) -> Self:
        """Return the operator of one view; kept, since its entries are copied to the device."""
        if number not in self._views:
            self._views[number] = super().view(number)
        return self._views[number]

    def computing(self) -> AbstractContextManager[None]:
        """Return the context in which the device's errors are one line, and its arrays its own."""
        return self.device.used()

    def product_there(self, x: Any) -> Any:
        """Return ``A x`` of another library's array on the device, in that library."""
        return self._on_foreign(self.forward, x, self.shape[1])

    def transposed_product_there(self, y: Any) -> Any:
        """Return ``A^T y`` of another library's array on the device, in that library."""
        return self._on_foreign(self.adjoint, y, self.shape[0])

    def _matvec(self, x: NDArray) -> NDArray:
        return self._on_numpy(self.forward, x.reshape(-1, 1)).ravel()

    def _rmatvec(self, y: NDArray) -> NDArray:
        return self._on_numpy(self.adjoint, y.reshape(-1, 1)).ravel()

    def _matmat(self, x: NDArray) -> NDArray:
        return self._on_numpy(self.forward, x)

    def _rmatmat(self, y: NDArray) -> NDArray:
        return self._on_numpy(self.adjoint, y)

    def _on_numpy(self, apply: Apply, values: NDArray) -> NDArray:
        return self.device.host(apply(self.device.array(as_float(values))))

    def _on_foreign(self, apply: Apply, values: Any, rows: int) -> Any:
        """Return the product of another library's array, as an array of that library."""
        own = self.device.adopt(values)
        if own.dtype not in (np.float32, np.float64) or own.shape[0] != rows or own.ndim > 2:
            raise ValueError(
                f"array on the device: found {own.dtype} {tuple(own.shape)}, expected float32 or "
                f"float64 with {rows} rows"
            )
        found = apply(own.reshape(rows, -1))
        found = found.reshape(-1) if own.ndim == 1 else found
        library = sys.modules[type(values).__module__.partition(".")[0]]
        return library.from_dlpack(found)
