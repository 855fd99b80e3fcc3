"""What solvers minimise: the misfit between measured and projected images.

==============  =====================================  =============================
loss            formula                                solvers
==============  =====================================  =============================
`LeastSquares`  ``||W^½ (b - A x)||² + s m ||D x||²``  cgls, projected_cg, curvature
`LeastSquares`  ``½ ||W^½ (b - A x)||² + s u R(x)``    proximal_gradient
`Poisson`       ``sum_p (A x)_p - b_p log (A x)_p``    mlem, with ``+ s l R(x)``
==============  =====================================  =============================

A prior is linear, ``D``, or proximal, ``R``: see `tomo.priors`. SIRT, SART and ART
descend least squares weighted by the reciprocal row sums of ``A``, SMART and MART the cross
entropy: those need no more than their update.
"""

from __future__ import annotations

import copy
from functools import cached_property
from typing import Any, Protocol, cast

import numpy as np
from numpy.typing import ArrayLike, NDArray

from tomo._compute.arrays import as_type, factors, flat, is_numpy, like, namespace, quotient, zeros
from tomo._compute.reductions import inner, largest
from tomo.operators.operator import ProjectionOperator
from tomo.operators.vectors import (
    additive_start,
    beside,
    by_columns,
    check_measured,
    check_weights,
    damped,
    given,
    unit_of,
)


class LinearPrior(Protocol):
    """A prior ``||D x||²``: a linear map ``D`` of the unknowns whose squares count as misfit."""

    def forward(self, values: NDArray[np.float32]) -> NDArray[np.float32]:
        """Return ``D x`` of the unknowns ``x (unknowns,)``, in any shape."""

    def adjoint(self, field: NDArray[np.float32]) -> NDArray[np.float32]:
        """Return ``D^T p (unknowns,)`` of a flat ``p``."""


class LeastSquares:
    """The loss ``||W^½ (b - A x)||² + s m ||D x||²``, as rows stacked below each other.

    Parameters
    ----------
    projector : ProjectionOperator
        ``A``.
    measured : (pixels,) or (pixels, columns)
        ``b``; columns are as many problems, solved at once.
    weights : as measured, optional
        The diagonal of ``W``; None is one everywhere.
    prior : LinearPrior, optional
        ``D``, see `tomo.priors`.
    strength : float
        ``s``; at zero the prior is left out.

    Raises
    ------
    ValueError
        If pixels or weights are too few or too many or not finite, or weights or the strength are
        negative.
    TypeError
        If the prior is not linear.

    Notes
    -----
    ``m`` is the largest element of ``A^T W A 1``, which bounds the largest eigenvalue of
    ``A^T W A``: the strength ``s`` has no unit, and depends neither on the unit of the images, the
    weights or the length nor on the number of rays. Images and weights are divided by powers of
    two, so that squares and sums stay inside the range of single precision; unknowns are in units
    of ``unit``.
    """

    def __init__(
        self,
        projector: ProjectionOperator,
        measured: ArrayLike,
        weights: ArrayLike | None = None,
        prior: LinearPrior | None = None,
        strength: float = 0.0,
    ) -> None:
        self.projector = projector
        measured, weights = _checked(projector, measured, weights)
        self.root = None if weights is None else namespace(weights).sqrt(weights)
        self.unit = factors(unit_of(measured), measured)
        self.measured = self._weighted(measured / self.unit)  # (pixels,) or (pixels, columns)
        self._add(prior, strength)

    def with_prior(self, prior: LinearPrior, strength: float) -> LeastSquares:
        """Return the same images, weights and `curvature` with another prior."""
        other = copy.copy(self)
        other._add(prior, strength)
        return other

    def _add(self, prior: LinearPrior | None, strength: float) -> None:
        self.prior, self._factor = None, 0.0
        if prior is not None:
            check_prior(prior, "forward", "adjoint")
        if check_strength(strength) > 0 and prior is not None:
            factor = np.sqrt(strength * largest(self.curvature).astype(np.float64))
            self.prior, self._factor = prior, factors(factor.astype(np.float32), self.measured)

    @cached_property
    def curvature(self) -> NDArray[np.float32]:
        """``A^T W A 1``, one value an unknown: a diagonal matrix above ``A^T W A``.

        Entries of A are not negative, so the difference is diagonally dominant.
        """
        ones = self._zero_each() + 1
        return self.projector.T @ self._weighted(self._weighted(self.projector @ ones))

    @property
    def target(self) -> NDArray[np.float32]:
        """The right-hand side: the weighted images, and zeros for the rows of the prior."""
        if self.prior is None:
            return self.measured
        rows = self._rows(self.prior.forward(self._zero_each()))
        xp = namespace(rows)
        return xp.concat([self.measured, xp.zeros_like(rows)])

    def start(self, start: ArrayLike | None, nonnegative: bool) -> NDArray[np.floating]:
        """Return the unknowns to start from, in units of ``unit``."""
        if start is None:
            return self._zero_each()
        found = given(self.projector, start)
        columns = found if self.measured.ndim == 2 else flat(found)
        return (
            by_columns(lambda one: additive_start(self.projector, one, nonnegative), columns)
            / self.unit
        )

    def residual(self, x: NDArray[np.float32]) -> NDArray[np.float32]:
        """Return the right-hand side less all rows times ``x``; zeros are not projected."""
        return self.target - self.forward(x) if bool(namespace(x).any(x)) else self.target

    def forward(self, x: NDArray[np.float32]) -> NDArray[np.float32]:
        """Return all rows times ``x``."""
        image = self._weighted(self.projector @ x)
        if self.prior is None:
            return image
        rows = self._factor * self._rows(self.prior.forward(x))
        return namespace(image).concat([image, rows])

    def adjoint(self, rows: NDArray[np.float32]) -> NDArray[np.float32]:
        """Return the transpose times one value a row."""
        pixels = self.projector.shape[0]
        volume = self.projector.T @ self._weighted(rows[:pixels, ...])
        if self.prior is None:
            return volume
        return volume + self._factor * self.prior.adjoint(rows[pixels:, ...])

    def misfit(self, residual: NDArray[np.float32]) -> Any:
        """Return the norm of the images' weighted residual, a number or one a column."""
        images = residual[: self.projector.shape[0], ...]
        return np.sqrt(inner(images, images))

    def _zero_each(self) -> NDArray[np.float32]:
        """Return zeros of the shape of the unknowns, of each column."""
        return zeros((self.projector.shape[1], *self.measured.shape[1:]), self.measured)

    def _rows(self, field: NDArray[np.float32]) -> NDArray[np.float32]:
        """Return the prior's rows one below the other."""
        return namespace(field).reshape(field, (-1, *self.measured.shape[1:]))

    def _weighted(self, image: NDArray[np.float32]) -> NDArray[np.float32]:
        return image if self.root is None else self.root * image


def _checked(
    projector: ProjectionOperator, measured: ArrayLike, weights: ArrayLike | None
) -> tuple[NDArray[np.float32], NDArray[np.float32] | None]:
    """Return pixels and weights, flat or in columns, checked."""
    pixels = given(projector, measured)
    if pixels.ndim != 2 or pixels.shape[0] != projector.shape[0]:
        return check_measured(projector, pixels), check_weights(projector, weights)
    pixels = by_columns(lambda one: check_measured(projector, one), pixels)
    if weights is None:
        return pixels, None
    values = given(projector, weights)
    if values.shape != pixels.shape:
        found, expected = tuple(values.shape), tuple(pixels.shape)
        raise ValueError(f"weights: found shape {found}, expected {expected}")

    def checked(one: NDArray) -> NDArray:
        return cast("NDArray", check_weights(projector, one))  # None for None alone

    return pixels, by_columns(checked, values)


def check_prior(prior: object, *methods: str) -> None:
    """Check that a prior has the methods that a solver calls.

    Raises
    ------
    TypeError
        If it has not all of them.
    """
    if not all(callable(getattr(prior, name, None)) for name in methods):
        raise TypeError(
            f"prior: found {type(prior).__name__}, expected one with {' and '.join(methods)}; "
            "cgls and projected_cg take linear priors, proximal_gradient and mlem proximal ones"
        )


def check_strength(strength: float) -> float:
    """Return the strength of a prior.

    Raises
    ------
    ValueError
        If it is negative or not finite.
    """
    if not 0 <= strength < np.inf:
        raise ValueError(f"strength: found {strength}, expected a finite number >= 0")
    return float(strength)


BARELY_SEEN = 0.01
"""Fraction of the median column sum below which the update of a voxel is damped. Lower lets a
voxel that rays graze grow on their noise, higher slows voxels at the rim of the views."""


class Poisson:
    """The negative log-likelihood of pixels ``b`` as Poisson counts of mean ``A x``.

    Parameters
    ----------
    projector : ProjectionOperator
        ``A``.
    measured : (pixels,) or (pixels, columns) float32
        ``b``; pixels below zero count as zero.
    fair : (unknowns,) float64 or 0
        Column sums that those of ``A`` count as at least, see `sensitivity`.

    Notes
    -----
    ``L(x) = sum_p (A x)_p - b_p log (A x)_p``, whose gradient is ``A^T 1 - A^T (b / A x)``. It
    falls at every update ``x <- x f`` by the `factor` ``f = A^T (b / A x) / A^T 1`` of
    expectation maximisation.
    """

    def __init__(
        self,
        projector: ProjectionOperator,
        measured: NDArray[np.float32],
        fair: NDArray[np.float64] | float = 0.0,
    ) -> None:
        self.projector = projector
        self.counts = namespace(measured).maximum(measured, 0.0)
        parts = sensitivity(projector.column_sums, fair)
        self._per_column, self._missing = (like(one, measured) for one in parts)

    def factor(self, projected: NDArray[np.float32]) -> NDArray[np.float64]:
        """Return the factor of every unknown, of each column, at ``A x``, ``(pixels, ...)``."""
        seen = self.projector.T @ ratio(self.counts, projected)
        return beside(self._per_column, seen) * (seen + beside(self._missing, seen))

    def step(self, x: NDArray[np.float32]) -> NDArray[np.float32]:
        """Return the diagonal metric ``C = x / A^T 1`` of the update, ``(unknowns,)``.

        The update is a step along the gradient in it: ``x f = x - C (A^T 1 - A^T (b / A x))``.
        """
        return as_type(x * self._per_column, np.float32)


def ratio(measured: NDArray[np.float32], projected: NDArray[np.float32]) -> NDArray[np.float64]:
    """Return ``measured / projected``, and 1 (no change) where nothing is projected.

    In double precision: the faint tail of a flame, 1e-40, would overflow a single.
    """
    if is_numpy(measured):
        one = np.ones(measured.shape)
        return np.divide(measured, projected, out=one, where=projected > 0, dtype=np.float64)
    return quotient(as_type(measured, np.float64), as_type(projected, np.float64), 1.0)


def sensitivity(
    column_sums: NDArray[np.float64], fair: NDArray[np.float64] | float = 0.0
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the reciprocal divisor of an update and the length that it lacks: (unknowns,) each.

    A voxel that rays barely graze could grow without bound on noise that it has next to no part
    in. The length ``m`` that it lacks to a hundredth of the median voxel's is treated as seen by
    rays that agree with it: ``x (A^T ratio + m) / (A^T 1 + m)``, which leaves every fixed point
    and every well-seen voxel as it is. The same holds for a voxel with few rays in a subset: the
    length that it lacks there to the ``fair`` fraction of all subsets is taken to agree, or the
    noise of the one ray that grazes it would be all of its update. A voxel that no ray meets keeps
    its value.
    """
    missing = np.maximum(damped(column_sums, BARELY_SEEN), fair) - column_sums
    return 1 / (column_sums + missing), missing
