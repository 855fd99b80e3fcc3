"""What levels and trends change of the images, with the voxels eliminated."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np
import torch
from numpy.typing import NDArray

from tomo._sums import dot
from tomo.smooth_basis import SmoothBasis
from tomo.solve import cgls
from tomo.solve.stopping import Choice, solve_as_chosen
from tomo.wernet.correction import ViewTokens
from tomo.wernet.ray_features import RayFeatures
from tomo.wernet.ray_weights import reweighted, trend_corrections

if TYPE_CHECKING:
    from tomo.projector import Projector
    from tomo.viewed import ViewedOperator

PATCH = 0.2
"""Side of the patches that an image's residuals are summed over, where the widest image is two
across. What voxels and single rays leave out changes sign within a patch, what light loses on its
way does not."""


@dataclass(frozen=True, eq=False)
class Thinned:
    """Some of the pixels, and the patches that their residuals are summed over.

    Attributes
    ----------
    projector : Projector
        Of chord lengths.
    measured : (pixels,) float32
    features : RayFeatures
    unit : float
        Of the emission in front.
    patches : Patches
    """

    projector: Projector
    measured: NDArray[np.float32]
    features: RayFeatures
    unit: float
    patches: Patches

    @classmethod
    def of(
        cls, projector: Projector, measured: NDArray[np.float32], stride: int, unit: float
    ) -> Thinned:
        """Take every so many-th pixel."""
        pixels = np.arange(0, projector.shape[0], stride)
        some = projector.take(pixels)
        features = RayFeatures.of(some)
        return cls(some, measured[pixels], features, unit, Patches.of(some, features))

    def __repr__(self) -> str:
        """Name the sizes."""
        return f"<Thinned: {len(self.measured)} pixels, {len(self.patches.view)} patches>"

    def at(self, tokens: ViewTokens, choice: Choice) -> Linearised:
        """Return how the images change about the levels and trends of ``tokens``."""
        volume = volume_with(
            self.projector, self.measured, self.features, tokens, choice, self.unit
        )
        front = self.features.emission_in_front(volume, self.unit)
        correction = trend_corrections(tokens, self.features, front)
        learned = reweighted(self.projector, correction)
        basis = SmoothBasis(learned, choice.width) if choice.width else learned
        free = _solved(basis, self.measured, choice)
        if isinstance(basis, SmoothBasis):
            free = basis.blur(free)
        residual = (self.measured - learned @ free).astype(np.float64)
        slope = 2 * learned.segments.length
        level = self.projector.with_lengths(slope) @ free
        return Linearised(
            self,
            choice,
            learned,
            basis,
            free,
            slope,
            self.features.trends(front),
            residual=self.patches.sum(residual),
            level=self.patches.sum(level),
        )


@dataclass(frozen=True, eq=False)
class Linearised:
    """What levels and trends change, to first order, of the residual that voxels leave.

    The residual is ``m - A(t) x(t)``, ``x(t)`` the solve with weights ``A(t)``. Its derivative is
    that of the rows at fixed voxels less what voxels can imitate of it (Kaufman's form of variable
    projection)::

        J_k = y_k - A z_k,   y_k = (dA / dt_k) x,   z_k the solve of A z = y_k

    For the levels of the views, of which the voxels can imitate little, ``J = y``.

    Attributes
    ----------
    some : Thinned
    choice : Choice
        How the voxels are solved for.
    learned : Projector
        With the weights about which it is linearised.
    basis : ViewedOperator
        The same, of the smooth basis of the choice.
    free : (unknowns,) float32
        Voxels of any sign: where some are held at zero, a solve is not linear.
    slope : (S,) float32
        The derivative of the weights by the logarithm of ``1 + c``.
    columns : tuple of (S,) float32
        What each trend is along.
    residual, level : (patches,) float64
        Summed over the patches: what is left, and what a view's level changes.

    References
    ----------
    Kaufman, "A variable projection method for solving separable nonlinear least squares problems",
    BIT 15 (1975).
    """

    some: Thinned
    choice: Choice
    learned: Projector
    basis: ViewedOperator
    free: NDArray[np.float32]
    slope: NDArray[np.float32]
    columns: tuple[NDArray[np.float32], ...]
    residual: NDArray[np.float64]
    level: NDArray[np.float64]
    _rows: dict[int, NDArray[np.float64]] = field(default_factory=dict)

    def __repr__(self) -> str:
        """Name the sizes."""
        return f"<Linearised: {self.some}, {self.choice.method}>"

    @property
    def view(self) -> NDArray[np.int64]:
        """The view of each patch, ``(patches,)``."""
        return self.some.patches.view

    def scale(self, trend: int) -> float:
        """Return the size of what a trend is along, in which `row` counts its change."""
        column = self.columns[trend]
        return math.sqrt(dot(column, column) / len(column)) + 1e-6

    def row(self, trend: int) -> NDArray[np.float64]:
        """Return what a trend changes that voxels do not imitate, ``(patches,)``."""
        if trend not in self._rows:
            slope = self.slope * self.columns[trend]
            image = self.some.projector.with_lengths(slope) @ self.free
            left = _not_imitated(self.basis, image, self.choice) / self.scale(trend)
            self._rows[trend] = self.some.patches.sum(left)
        return self._rows[trend]


@dataclass(frozen=True, eq=False)
class Patches:
    """Neighbouring pixels of a view, taken together.

    Attributes
    ----------
    of_pixel : (pixels,) int64
    view : (patches,) int64
    root_size : (patches,) float64
        The square root of its number of pixels.
    """

    of_pixel: NDArray[np.int64]
    view: NDArray[np.int64]
    root_size: NDArray[np.float64]

    @classmethod
    def of(cls, projector: Projector, features: RayFeatures, side: float = PATCH) -> Patches:
        """Cut each view's pixels into squares of ``side`` by their place in the image."""
        view = np.repeat(np.arange(projector.n_views), np.diff(projector.view_ptr))
        square = np.floor(features.place.numpy() / side).astype(np.int64)  # (pixels, 2)
        found, of_pixel, size = np.unique(
            np.column_stack([view, square]), axis=0, return_inverse=True, return_counts=True
        )
        return cls(of_pixel.reshape(-1), found[:, 0], np.sqrt(size))

    def sum(self, image: NDArray) -> NDArray[np.float64]:
        """Return the patches' sums of ``image`` (pixels,), white noise keeping its size."""
        return np.bincount(self.of_pixel, image, len(self.view)) / self.root_size


def volume_with(
    projector: Projector,
    measured: NDArray[np.float32],
    features: RayFeatures,
    tokens: ViewTokens,
    choice: Choice,
    unit: float,
) -> NDArray[np.float32]:
    """Return the voxels (unknowns,) of levels and trends, with the emission in front theirs."""
    front = torch.zeros_like(features.length)
    for _ in range(2 if tokens.trend[1] else 1):
        learned = reweighted(projector, trend_corrections(tokens, features, front))
        volume = projector.live.compress(solve_as_chosen(learned, measured, choice).volume)
        front = features.emission_in_front(volume, unit)
    return volume


def _not_imitated(
    basis: ViewedOperator, image: NDArray[np.float32], choice: Choice
) -> NDArray[np.float64]:
    """Return what is left of ``image`` once voxels, of any sign, have imitated it."""
    return (image - basis @ _solved(basis, image, choice)).astype(np.float64)


def _solved(
    basis: ViewedOperator, image: NDArray[np.float32], choice: Choice
) -> NDArray[np.float32]:
    """Return coefficients of any sign."""
    found = cgls(basis, image, iterations=choice.iterations, nonnegative=False)
    return basis.live.compress(found.volume)
