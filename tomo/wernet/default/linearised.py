"""What levels and trends change of the images, with the voxels eliminated."""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
import scipy.sparse
import torch
from numpy.typing import NDArray

from tomo._compute.reductions import dot, norm
from tomo.operators import GaussianBasis
from tomo.selection import Choice
from tomo.selection.choose import solve_as_chosen
from tomo.solvers import cgls
from tomo.wernet.default.correction import ViewTokens
from tomo.wernet.default.patch_noise import noise_of_pixels
from tomo.wernet.default.ray_features import RayFeatures
from tomo.wernet.default.ray_weights import reweighted, trend_corrections

if TYPE_CHECKING:
    from tomo.operators import Projector
    from tomo.operators.operator import ProjectionOperator

PATCH = 0.2
"""Side of the patches that an image's residuals are summed over, where the widest image is two
across. What voxels and single rays leave out changes sign within a patch, what light loses on its
way does not."""

DETERMINED = 4
"""Pixels an unknown from which on boxes are eliminated, not what was chosen to solve by: a smooth
basis, or an early stop, leaves detail for levels and trends to explain. With fewer pixels boxes
imitate what levels do: gains were found three times less exactly by two pixels an unknown."""

ELIMINATION = 30
"""Iterations after which boxes imitate what they can."""


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
    noise : float
        Its standard deviation in a pixel.
    """

    projector: Projector
    measured: NDArray[np.float32]
    features: RayFeatures
    unit: float
    patches: Patches
    noise: float

    @classmethod
    def of(
        cls,
        projector: Projector,
        measured: NDArray[np.float32],
        stride: int,
        unit: float,
        widest: tuple[float, float] | None = None,
    ) -> Thinned:
        """Take every so many-th pixel; ``widest`` is that of all, see `RayFeatures`."""
        pixels = np.arange(0, projector.shape[0], stride)
        some = projector.take(pixels)
        features = RayFeatures.of(some, widest=widest)
        noise = noise_of_pixels(measured)  # of all pixels: neighbours tell it from what they show
        return cls(some, measured[pixels], features, unit, Patches.of(some, features), noise)

    def __repr__(self) -> str:
        """Name the sizes."""
        return f"<Thinned: {len(self.measured)} pixels, {len(self.patches.view)} patches>"

    @cached_property
    def smaller_patches(self) -> Patches:
        """Patches of half the side."""
        return Patches.of(self.projector, self.features, PATCH / 2)

    def at(self, tokens: ViewTokens, choice: Choice) -> Linearised:
        """Return how the images change about the levels and trends of ``tokens``."""
        volume = volume_with(
            self.projector, self.measured, self.features, tokens, choice, self.unit
        )
        front = self.features.emission_in_front(volume, self.unit)
        correction = trend_corrections(tokens, self.features, front)
        learned = reweighted(self.projector, correction)
        eliminated = choice
        if self.projector.shape[0] >= DETERMINED * self.projector.shape[1]:
            eliminated = replace(choice, width=0.0, iterations=ELIMINATION)
        basis = GaussianBasis(learned, eliminated.width) if eliminated.width else learned
        free = _solved(basis, self.measured, eliminated)
        if isinstance(basis, GaussianBasis):
            free = basis.to_voxels(free)
        residual = (self.measured - learned @ free).astype(np.float64)
        slope = 2 * learned.segments.length
        level = self.projector.with_lengths(slope) @ free
        return Linearised(
            self,
            choice,
            eliminated,
            learned,
            basis,
            free,
            slope,
            self.features.trends(front),
            misfit=norm(residual),
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
        How the voxels are solved for whose emission stands in front.
    eliminated : Choice
        How voxels of any sign are.
    learned : Projector
        With the weights about which it is linearised.
    basis : ProjectionOperator
        The same, of the smooth basis that is eliminated.
    free : (unknowns,) float32
        Voxels of any sign: where some are held at zero, a solve is not linear.
    slope : (S,) float32
        The derivative of the weights by the logarithm of ``1 + c``.
    columns : tuple of (S,) float32
        What each trend is along.
    misfit : float
        What is left of the pixels, its norm.
    residual, level : (patches,) float64
        Summed over the patches: what is left, and what a view's level changes.

    References
    ----------
    Kaufman, "A variable projection method for solving separable nonlinear least squares problems",
    BIT 15 (1975).
    """

    some: Thinned
    choice: Choice
    eliminated: Choice
    learned: Projector
    basis: ProjectionOperator
    free: NDArray[np.float32]
    slope: NDArray[np.float32]
    columns: tuple[NDArray[np.float32], ...]
    misfit: float
    residual: NDArray[np.float64]
    level: NDArray[np.float64]
    _rows: dict[int, NDArray[np.float64]] = field(default_factory=dict)

    def __repr__(self) -> str:
        """Name the sizes."""
        return f"<Linearised: {self.some}, {self.choice.method}>"

    @cached_property
    def noise(self) -> NDArray[np.float64]:
        """What voxels leave of a sample of the images' noise, summed over the patches.

        As large as it is expected to be: by chance the sample is itself some per cent larger or
        smaller. No larger than all that is left of the pixels.
        """
        patches = self.some.patches
        if not self.some.noise:
            return np.zeros_like(self.residual)
        sample = np.random.default_rng(0).standard_normal(len(self.some.measured))
        left = _not_imitated(self.basis, sample.astype(np.float32), self.eliminated)
        expected = math.sqrt(len(self.residual)) / norm(patches.sum(sample))
        noise = min(self.some.noise * expected, self.misfit / (norm(left) or 1.0))
        return noise * patches.sum(left)

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
            left = _not_imitated(self.basis, image, self.eliminated) / self.scale(trend)
            self._rows[trend] = self.some.patches.sum(left)
        return self._rows[trend]


@dataclass(frozen=True, eq=False)
class Patches:
    """Neighbouring pixels of a view, taken together.

    A patch is a tent, two sides wide, and its neighbours overlap: what changes sign from pixel to
    pixel cancels within it as it does not within a box, which cuts through it at its edge.

    Attributes
    ----------
    tents : (patches, pixels) sparse, float64
        The weight of each pixel; their squares add up to one in each patch.
    view : (patches,) int64
    """

    tents: scipy.sparse.csr_array
    view: NDArray[np.int64]

    @property
    def pixels_each(self) -> float:
        """How many pixels there are for each patch."""
        return self.tents.shape[1] / max(self.tents.shape[0], 1)

    @classmethod
    def of(cls, projector: Projector, features: RayFeatures, side: float = PATCH) -> Patches:
        """Lay tents ``side`` apart over each view's pixels, by their place in the image."""
        view = np.repeat(np.arange(projector.n_views), np.diff(projector.view_ptr))
        place = features.place.numpy().astype(np.float64) / side  # (pixels, 2)
        below = np.floor(place).astype(np.int64)
        share, below = place - below, below - below.min(axis=0)
        across, up = below.max(axis=0) + 2
        near = [
            (
                (view * across + below[:, 0] + right) * up + below[:, 1] + above,
                np.abs(1 - right - share[:, 0]) * np.abs(1 - above - share[:, 1]),
            )
            for right, above in itertools.product((0, 1), repeat=2)
        ]
        number, weight = (np.concatenate(each) for each in zip(*near, strict=True))
        pixel, some = np.tile(np.arange(len(view)), 4), weight > 0
        found, patch = np.unique(number[some], return_inverse=True)
        size = np.sqrt(np.bincount(patch, weight[some] ** 2))
        tents = scipy.sparse.csr_array(
            (weight[some] / size[patch], (patch, pixel[some])), (len(found), len(view))
        )
        return cls(tents, found // (across * up))

    def sum(self, image: NDArray) -> NDArray[np.float64]:
        """Return the patches' sums of ``image`` (pixels,), white noise keeping its size."""
        return self.tents @ np.asarray(image, np.float64)


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
        volume = projector.active.compress(solve_as_chosen(learned, measured, choice).volume)
        front = features.emission_in_front(volume, unit)
    return volume


def _not_imitated(
    basis: ProjectionOperator, image: NDArray[np.float32], choice: Choice
) -> NDArray[np.float64]:
    """Return what is left of ``image`` once voxels, of any sign, have imitated it."""
    return (image - basis @ _solved(basis, image, choice)).astype(np.float64)


def _solved(
    basis: ProjectionOperator, image: NDArray[np.float32], choice: Choice
) -> NDArray[np.float32]:
    """Return coefficients of any sign."""
    found = cgls(basis, image, iterations=choice.iterations, nonnegative=False)
    return basis.active.compress(found.volume)
