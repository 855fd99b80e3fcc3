"""Products of arrays of other libraries than NumPy, where an operator takes them."""

from __future__ import annotations

from abc import abstractmethod
from typing import Any

from numpy.typing import NDArray
from scipy.sparse.linalg import LinearOperator

from tomo.operators.operator import ProjectionOperator


class ArrayProducts(ProjectionOperator):
    """A projection operator whose products stay where their argument is, if it `takes` that."""

    @abstractmethod
    def takes(self, values: Any) -> bool:
        """Return whether an argument is another library's array that its product stays with."""

    @abstractmethod
    def product_there(self, x: Any) -> Any:
        """Return ``A x`` of an array that it takes, ``(unknowns,)`` or ``(unknowns, columns)``."""

    @abstractmethod
    def transposed_product_there(self, y: Any) -> Any:
        """Return ``A^T y`` of an array that it takes, ``(pixels,)`` or ``(pixels, columns)``."""

    def dot(self, x: Any) -> Any:
        """Return ``A @ x``."""
        return self.product_there(x) if self.takes(x) else super().dot(x)

    def _adjoint(self) -> LinearOperator:
        return _Adjoint(self)


class _Adjoint(LinearOperator):
    """``A.T``, which takes the same arrays."""

    def __init__(self, of: ArrayProducts) -> None:
        self.of = of
        super().__init__(dtype=of.dtype, shape=of.shape[::-1])

    def takes(self, values: Any) -> bool:
        """Return whether a product stays where its argument is."""
        return self.of.takes(values)

    def dot(self, y: Any) -> Any:
        """Return ``A.T @ y``."""
        return self.of.transposed_product_there(y) if self.takes(y) else super().dot(y)

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
