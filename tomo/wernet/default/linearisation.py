"""The change of the images with gains and global terms, the voxels eliminated."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
import torch
from numpy.typing import NDArray

from tomo._compute.reductions import dot, norm
from tomo.measurement.pixel_noise import noise_from_differences
from tomo.operators import GaussianBasis
from tomo.selection import Choice, solve_as_chosen
from tomo.solvers.cgls import cgls
from tomo.wernet.default.correction import ViewParameters
from tomo.wernet.default.patches import Patches
from tomo.wernet.default.ray_features import RayFeatures
from tomo.wernet.default.ray_weights import parametric_corrections, reweighted

if TYPE_CHECKING:
    from tomo.operators import Projector
    from tomo.operators.operator import ProjectionOperator

DETERMINED = 4
"""Pixels an unknown from which on plain voxels are eliminated instead of the chosen basis. Fewer:
voxels imitate gains. More: a smooth basis leaves detail that terms then explain."""

ELIMINATION = 30
"""Iterations of that elimination. Fewer: voxels do not imitate all they can. More: time only."""


@dataclass(frozen=True, eq=False)
class PixelSubset:
    """Some of the pixels, and the patches over which their residuals are summed.

    Attributes
    ----------
    projector : Projector
        Its entries are segment lengths.
    measured : (pixels,) float32
    features : RayFeatures
    unit : float
        Unit of the upstream emission.
    patches : Patches
    noise : float
        Standard deviation of the noise in a pixel.
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
        image_scale: tuple[float, float] | None = None,
        held: NDArray[np.bool_] | None = None,
    ) -> PixelSubset:
        """Take every ``stride``-th pixel that is not ``held`` out, ``(pixels,)`` bool.

        ``image_scale`` is that of all, see `RayFeatures`.
        """
        pixels = np.arange(projector.shape[0]) if held is None else np.flatnonzero(~held)
        pixels = pixels[::stride]
        subset = projector.take(pixels)
        features = RayFeatures.of(subset, image_scale=image_scale)
        noise = noise_from_differences(measured)  # of all pixels: it needs true neighbours
        patches = Patches.of(subset, features)
        return cls(subset, measured[pixels], features, unit, patches, noise)

    def __repr__(self) -> str:
        """Name the sizes."""
        return f"<PixelSubset: {len(self.measured)} pixels, {len(self.patches.view)} patches>"

    def linearise(
        self,
        view_parameters: ViewParameters,
        choice: Choice,
        volume: NDArray[np.float32] | None = None,
    ) -> Linearisation:
        """Return how the images change about these gains and coefficients.

        ``volume``, (unknowns,), is that of the upstream emission; solved for when None.
        """
        if volume is None:
            volume = self._volume(view_parameters, choice)
        upstream = self.features.upstream_emission(volume, self.unit)
        correction = parametric_corrections(view_parameters, self.features, upstream)
        weighted = reweighted(self.projector, correction)
        elimination = choice
        if self.projector.shape[0] >= DETERMINED * self.projector.shape[1]:
            elimination = replace(choice, width=0.0, iterations=ELIMINATION)
        basis = GaussianBasis(weighted, elimination.width) if elimination.width else weighted
        signed = _signed_solve(basis, self.measured, elimination)
        if isinstance(basis, GaussianBasis):
            signed = basis.to_voxels(signed)
        residual = (self.measured - weighted @ signed).astype(np.float64)
        slope = 2 * weighted.segments.length
        gain_change = self.projector.with_lengths(slope) @ signed
        return Linearisation(
            self,
            choice,
            elimination,
            weighted,
            basis,
            signed,
            slope,
            self.features.terms(upstream),
            misfit=norm(residual),
            residual=self.patches.sum(residual),
            gain_change=self.patches.sum(gain_change),
        )

    def _volume(self, view_parameters: ViewParameters, choice: Choice) -> NDArray[np.float32]:
        """Return the voxels (unknowns,) solved for with gains and global terms.

        The upstream emission needs a volume itself: where its coefficient is not zero the solve is
        done a second time with that of the first.
        """
        projector, features = self.projector, self.features
        upstream = torch.zeros_like(features.length)
        for _ in range(2 if view_parameters.coefficients[1] else 1):
            correction = parametric_corrections(view_parameters, features, upstream)
            found = solve_as_chosen(reweighted(projector, correction), self.measured, choice)
            volume = projector.active.compress(found.volume)
            upstream = features.upstream_emission(volume, self.unit)
        return volume


@dataclass(frozen=True, eq=False)
class Linearisation:
    """First-order change, with gains and coefficients, of the residual that voxels leave.

    Attributes
    ----------
    subset : PixelSubset
    choice : Choice
        The solve for the volume of the upstream emission.
    elimination : Choice
        The solve for voxels of any sign.
    weighted : Projector
        With the weights about which it is linearised.
    basis : ProjectionOperator
        The same in the basis that is eliminated.
    signed : (unknowns,) float32
        Voxels of any sign: a solve that holds some at zero is not linear.
    slope : (S,) float32
        Derivative of the weights by the logarithm of ``1 + c``.
    terms : tuple of (S,) float32
        Values of `tomo.wernet.default.ray_features.TERMS`.
    misfit : float
        Norm of the pixels' residual.
    residual, gain_change : (patches,) float64
        Sums over the patches: the residual, and the change with a view's gain.

    Notes
    -----
    The residual is ``m - A(t) x(t)``, with ``x(t)`` the solve with weights ``A(t)``. Its
    derivative is that of the rows at fixed voxels less the part that voxels can imitate (Kaufman's
    form of variable projection)::

        J_k = y_k - A z_k,   y_k = (dA / dt_k) x,   z_k the solve of A z = y_k

    Voxels can imitate little of the views' gains: for these ``J = y``.

    References
    ----------
    Kaufman, "A variable projection method for solving separable nonlinear least squares problems",
    BIT 15 (1975).
    """

    subset: PixelSubset
    choice: Choice
    elimination: Choice
    weighted: Projector
    basis: ProjectionOperator
    signed: NDArray[np.float32]
    slope: NDArray[np.float32]
    terms: tuple[NDArray[np.float32], ...]
    misfit: float
    residual: NDArray[np.float64]
    gain_change: NDArray[np.float64]
    _columns: dict[int, NDArray[np.float64]] = field(default_factory=dict)

    def __repr__(self) -> str:
        """Name the sizes."""
        return f"<Linearisation: {self.subset}, strength {self.choice.strength:g}>"

    @cached_property
    def noise(self) -> NDArray[np.float64]:
        """The part of a sample of the images' noise that voxels leave, summed over patches.

        The sample is scaled to the expected size of noise, as it is itself some per cent larger
        or smaller by chance, and to no more than the pixels' whole residual.
        """
        patches = self.subset.patches
        if not self.subset.noise:
            return np.zeros_like(self.residual)
        sample = np.random.default_rng(0).standard_normal(len(self.subset.measured))
        left = _not_imitated(self.basis, sample.astype(np.float32), self.elimination)
        expected = math.sqrt(len(self.residual)) / norm(patches.sum(sample))
        noise = min(self.subset.noise * expected, self.misfit / (norm(left) or 1.0))
        return noise * patches.sum(left)

    @property
    def view(self) -> NDArray[np.int64]:
        """The view of each patch, ``(patches,)``."""
        return self.subset.patches.view

    def scale(self, term: int) -> float:
        """Return the root mean square of a term, the unit of its `column`."""
        values = self.terms[term]
        return math.sqrt(dot(values, values) / len(values)) + 1e-6

    def column(self, term: int) -> NDArray[np.float64]:
        """Return the Jacobian column of a term's coefficient, ``(patches,)``."""
        if term not in self._columns:
            slope = self.slope * self.terms[term]
            image = self.subset.projector.with_lengths(slope) @ self.signed
            left = _not_imitated(self.basis, image, self.elimination) / self.scale(term)
            self._columns[term] = self.subset.patches.sum(left)
        return self._columns[term]


def _not_imitated(
    basis: ProjectionOperator, image: NDArray[np.float32], choice: Choice
) -> NDArray[np.float64]:
    """Return the part of ``image`` that voxels of any sign cannot imitate, ``(pixels,)``."""
    return (image - basis @ _signed_solve(basis, image, choice)).astype(np.float64)


def _signed_solve(
    basis: ProjectionOperator, image: NDArray[np.float32], choice: Choice
) -> NDArray[np.float32]:
    """Return coefficients of any sign, ``(unknowns,)``."""
    found = cgls(basis, image, iterations=choice.iterations, nonnegative=False)
    return basis.active.compress(found.volume)
