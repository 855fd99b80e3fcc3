"""What operators on a device share: arguments of any library, and columns."""

from __future__ import annotations

import sys
from abc import abstractmethod
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.sparse.linalg import LinearOperator

from tomo.operators.gpu.device import Device
from tomo.operators.operator import ProjectionOperator, as_float

Apply = Callable[[Any], Any]
"""Takes values ``(rows, columns)`` on the device to others there."""


class DeviceOperator(ProjectionOperator):
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
        is_numpy = isinstance(values, np.ndarray | np.generic)
        return hasattr(values, "__dlpack__") and not is_numpy and self.device.holds(values)

    def dot(self, x: Any) -> Any:
        """Return ``A @ x``."""
        if self.takes(x):
            return self._on_foreign(self.forward, x, self.shape[1])
        return super().dot(x)

    def _adjoint(self) -> LinearOperator:
        return _Adjoint(self)

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


class _Adjoint(LinearOperator):
    """``A.T``, which takes arrays on the device too."""

    def __init__(self, of: DeviceOperator) -> None:
        self.of = of
        super().__init__(dtype=of.dtype, shape=of.shape[::-1])

    def takes(self, values: Any) -> bool:
        """Return whether an argument stays on the device."""
        return self.of.takes(values)

    def dot(self, y: Any) -> Any:
        """Return ``A.T @ y``."""
        if self.takes(y):
            return self.of._on_foreign(self.of.adjoint, y, self.shape[1])
        return super().dot(y)

    def _matvec(self, y: NDArray) -> NDArray:
        return self.of._rmatvec(y)

    def _matmat(self, y: NDArray) -> NDArray:
        return self.of._rmatmat(y)

    def _rmatvec(self, x: NDArray) -> NDArray:
        return self.of._matvec(x)

    def _rmatmat(self, x: NDArray) -> NDArray:
        return self.of._matmat(x)

    def _adjoint(self) -> LinearOperator:
        return self.of

    def _transpose(self) -> LinearOperator:
        return self.of
