"""Weighted least squares: the one place that knows of pixel weights, units and added rows."""

from __future__ import annotations

import copy
from functools import cached_property
from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from tomo._compute.reductions import norm
from tomo.operators.operator import ProjectionOperator
from tomo.solvers.iterate import additive_start, check_measured, unit_of


class Penalty(Protocol):
    """A linear map ``D`` of the unknowns; its squares are added to those of the residual."""

    def forward(self, values: NDArray[np.float32]) -> NDArray[np.float32]:
        """Return ``D x`` of the unknowns ``x (n,)``, in any shape."""

    def adjoint(self, field: NDArray[np.float32]) -> NDArray[np.float32]:
        """Return ``D^T p (n,)`` of a flat ``p``."""


class Size:
    """The identity: penalises the unknowns themselves."""

    def forward(self, values: NDArray[np.float32]) -> NDArray[np.float32]:
        """Return ``x``."""
        return values

    def adjoint(self, field: NDArray[np.float32]) -> NDArray[np.float32]:
        """Return ``p``."""
        return field


class LeastSquares:
    """``||W^½ (b - A x)||² + s m ||D x||²``, as rows stacked below each other.

    ``m`` is the largest element of ``A^T W A 1``, which bounds the largest eigenvalue of
    ``A^T W A``: the strength ``s`` has no unit, and knows neither the images' intensity nor the
    weights' nor the length's unit nor how many rays there are. Images and weights are divided by
    powers of two, so that squares and sums stay inside the range of single precision; unknowns
    are in units of ``unit``.

    Parameters
    ----------
    projector : ProjectionOperator
        ``A``.
    measured : (pixels,)
        ``b``.
    weights : (pixels,), optional
        The diagonal of ``W``; None is one everywhere.
    penalty : Penalty, optional
        ``D``.
    strength : float
        ``s``; at zero the penalty is left out.

    Raises
    ------
    ValueError
        If pixels or weights are too few or too many or not finite, or weights or the strength are
        negative.
    """

    def __init__(
        self,
        projector: ProjectionOperator,
        measured: ArrayLike,
        weights: ArrayLike | None = None,
        penalty: Penalty | None = None,
        strength: float = 0.0,
    ) -> None:
        self.projector = projector
        measured = check_measured(projector, measured)
        weights = check_weights(projector, weights)
        self.root = None if weights is None else np.sqrt(weights)
        self.unit = unit_of(measured)
        self.measured = self._weighed(measured / self.unit)  # (pixels,)
        self._penalise(penalty, strength)

    def with_penalty(self, penalty: Penalty, strength: float) -> LeastSquares:
        """Return the same images, weights and `curvature` with another penalty."""
        other = copy.copy(self)
        other._penalise(penalty, strength)
        return other

    def _penalise(self, penalty: Penalty | None, strength: float) -> None:
        self.penalty, self._factor = None, np.float32(0)
        if check_strength(strength) > 0 and penalty is not None:
            largest = float(self.curvature.max(initial=0.0))
            self.penalty, self._factor = penalty, np.float32(np.sqrt(strength * largest))

    @cached_property
    def curvature(self) -> NDArray[np.float32]:
        """``A^T W A 1``, ``(unknowns,)``: a diagonal matrix above ``A^T W A``.

        Entries of A are not negative, so the difference is diagonally dominant.
        """
        ones = np.ones(self.projector.shape[1], np.float32)
        return self.projector.T @ self._weighed(self._weighed(self.projector @ ones))

    @property
    def target(self) -> NDArray[np.float32]:
        """The right-hand side: the weighted images, and zeros for the penalty's rows."""
        if self.penalty is None:
            return self.measured
        rows = self.penalty.forward(np.zeros(self.projector.shape[1], np.float32)).size
        return np.concatenate([self.measured, np.zeros(rows, np.float32)])

    def start(self, start: ArrayLike | None, nonnegative: bool) -> NDArray[np.float32]:
        """Return the unknowns to start from, in units of ``unit``."""
        return additive_start(self.projector, start, nonnegative) / self.unit

    def residual(self, x: NDArray[np.float32]) -> NDArray[np.float32]:
        """Return the right-hand side less all rows times ``x``; nothing is projected of zeros."""
        return self.target - self.forward(x) if x.any() else self.target

    def forward(self, x: NDArray[np.float32]) -> NDArray[np.float32]:
        """Return all rows times ``x``."""
        image = self._weighed(self.projector @ x)
        if self.penalty is None:
            return image
        return np.concatenate([image, self._factor * self.penalty.forward(x).ravel()])

    def adjoint(self, rows: NDArray[np.float32]) -> NDArray[np.float32]:
        """Return the transpose times one value a row."""
        pixels = self.projector.shape[0]
        volume = self.projector.T @ self._weighed(rows[:pixels])
        if self.penalty is None:
            return volume
        return volume + self._factor * self.penalty.adjoint(rows[pixels:])

    def misfit(self, residual: NDArray[np.float32]) -> float:
        """Return the norm of the weighted residual of the images alone."""
        return norm(residual[: self.projector.shape[0]])

    def _weighed(self, image: NDArray[np.float32]) -> NDArray[np.float32]:
        return image if self.root is None else self.root * image


def check_weights(
    projector: ProjectionOperator, weights: ArrayLike | None
) -> NDArray[np.float32] | None:
    """Return the weights of the pixels in float32, the largest between 1 and 2; None stays None.

    What a common factor does to least squares is nothing; a power of two does so exactly.

    Raises
    ------
    ValueError
        If there are not as many weights as pixels, or one is negative or not finite.
    """
    if weights is None:
        return None
    weights = np.asarray(weights, np.float64).ravel()
    if len(weights) != projector.shape[0]:
        raise ValueError(
            f"weights: found {len(weights)}, expected one for each of the projector's "
            f"{projector.shape[0]} pixels"
        )
    wrong = np.count_nonzero(~(np.isfinite(weights) & (weights >= 0)))
    if wrong:
        raise ValueError(f"weights: found {wrong} negative, NaN or infinite, expected >= 0")
    largest = float(weights.max(initial=0.0))
    if largest == 0:
        return weights.astype(np.float32)
    return np.ldexp(weights, 1 - int(np.frexp(largest)[1])).astype(np.float32)


def check_strength(strength: float) -> float:
    """Return a penalty's strength.

    Raises
    ------
    ValueError
        If it is negative or not finite.
    """
    if not 0 <= strength < np.inf:
        raise ValueError(f"strength: found {strength}, expected a finite number >= 0")
    return float(strength)
