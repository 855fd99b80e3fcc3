"""What may be wrong with a whole set of images: cameras' gains, and gas that absorbs."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tomo.operators import Absorption, LinearSystem
from tomo.operators.view_gains import Gains
from tomo.screening.hypotheses import TRANSPARENT, WORTH, Evidence, Fitted
from tomo.selfcal.gains import fit_gains
from tomo.selfcal.total_light import ViewLight

ABSORBING = 0.6
"""Fraction of the error beyond noise that absorption may leave to be taken. Above, it smooths the
edges of a transparent ball and doubles its light; below, weak absorption is left uncorrected."""

FIRST_DEPTH = 0.2
"""Optical depth that is tried first. Gas of a quarter of it changes the volume by less than its
voxels do; from far above, weak absorption would look worse than none."""

DOUBLINGS = 3
"""Times that the depth is doubled while that helps: far beyond 1.6 little arrives from behind, and
a volume that absorbs most of its light fits whatever is wrong."""

REFINEMENTS = 2
"""Parabolas through the three best depths: one more changes the depth by a hundredth of it."""

OUTER = 2
"""Solves with the emission of the one before for each depth, from that of the depth before."""

TURNS = 5
"""Solves by turns with the gains, at the most. Fewer leave gains that are still settling, which an
absorption tried on top seems to mend; more cost time."""

SETTLED = 0.97
"""Fraction of the error that a turn leaves where gains have settled. Lower, they still move;
higher, turns are for nothing."""


@dataclass(frozen=True)
class CameraGains:
    """Every camera has a gain and a background of its own.

    Attributes
    ----------
    name : str
    reference : tuple of bool, optional
        The views whose gains have the mean 1; all when None.
    how : mapping
        See `AbsorbingGas`.
    """

    name: str = "gain"
    reference: tuple[bool, ...] | None = None
    how: Mapping[str, Any] = field(default_factory=dict)

    @property
    def worth(self) -> float:
        """Fraction of the error beyond noise that it may leave."""
        return WORTH

    def fit(self, fitted: Fitted, evidence: Evidence) -> Sequence[Fitted]:
        """Fit both by turns with the volume, where views disagree; see `tomo.selfcal.gains`."""
        none = Gains.none(fitted.model.system.projector.n_views, self.reference)
        causes = (*fitted.model.causes, self.name)
        given = replace(fitted, model=replace(fitted.model, gains=none, causes=causes))
        found = with_gains_fitted(given, evidence, self.how)
        return [] if found is given else [found]


@dataclass(frozen=True)
class AbsorbingGas:
    """Gas absorbs light: an even medium that fills the grid, or the emitting gas itself.

    Attributes
    ----------
    name : str
    by_emission : bool
    how : mapping
        The tracer and the rays a pixel that the equations are made with, as
        `LinearSystem.with_absorption` takes them.
    """

    name: str
    by_emission: bool
    how: Mapping[str, Any] = field(default_factory=dict)

    @property
    def worth(self) -> float:
        """Fraction of the error beyond noise that it may leave."""
        return ABSORBING

    def fit(self, fitted: Fitted, evidence: Evidence) -> Sequence[Fitted]:
        """Search for the coefficient that predicts pixels left out best."""
        depth = self._depth(fitted)
        if not depth > 0:
            return []

        def at(strength: float, near: Fitted) -> Fitted:
            return self._with(strength, fitted, near, evidence)

        first = FIRST_DEPTH / depth
        if self._with(first, fitted, fitted, evidence, outer=1).error >= fitted.error:
            return []  # most images, at the cost of one solve
        found = _least(at, fitted, first)
        return [] if found is fitted else [found]

    def _depth(self, fitted: Fitted) -> float:
        """Return the optical depth of a coefficient of one: of the brightest ray, of the grid."""
        projector = fitted.model.system.projector
        if self.by_emission:
            return float((projector @ fitted.volume).max(initial=0.0))
        return float(np.mean(projector.grid.extent))

    def _with(
        self, strength: float, before: Fitted, near: Fitted, evidence: Evidence, outer: int = OUTER
    ) -> Fitted:
        """Return the fit of one strength, from that of another strength nearby."""
        system, causes = before.model.system, (*before.model.causes, self.name)
        own = {"emission" if self.by_emission else "medium": strength}
        absorption = replace(before.model.absorption, **own)
        for _ in range(outer if absorption.emission else 1):
            emission = volume_of(system, near.volume)
            system = system.with_absorption(absorption, emission, **self.how)
            model = replace(before.model, system=system, absorption=absorption, causes=causes)
            near = evidence.fit(model, near.volume)
            if model.gains is not None:  # they took some of what the gas absorbs
                near = with_gains_fitted(near, evidence, self.how)
        return near


def with_gains_fitted(fitted: Fitted, evidence: Evidence, how: Mapping[str, Any]) -> Fitted:
    """Return the fit with the gains and backgrounds that its volume asks for; itself if none.

    ``how`` is as for the causes. The volume is that of some pixels; totals are those of all, those
    left out too: gaps in an image would cut through voxels, and a view has one gain and many
    pixels.
    """
    model = fitted.model
    gains = model.gains or Gains.none(model.system.projector.n_views)
    system, light = model.system, light_of(model.system, model.absorption, how)
    for _ in range(TURNS):
        corrected = gains.correct(system.projector, evidence.measured)
        gains = gains.then(fit_gains(system, corrected, fitted.volume, light=light))
        if not gains.views_disagree:
            break
        before = fitted.error
        fitted = evidence.fit(replace(model, gains=gains), fitted.volume)
        if fitted.error > SETTLED * before:
            break
    return fitted


def light_of(system: LinearSystem, absorption: Absorption, how: Mapping[str, Any]) -> ViewLight:
    """Return the light of views through gas that absorbs, or not; ``how`` as for the causes."""
    return ViewLight.of(system, system.with_absorption(TRANSPARENT, **how) if absorption else None)


def volume_of(system: LinearSystem, unknowns: NDArray[np.float32]) -> NDArray[np.float32]:
    """Return the mean emission in every voxel, ``(nx, ny, nz)``, of the unknowns of a system."""
    projector = system.projector
    return projector.voxel_means(projector.active.expand(unknowns).reshape(projector.grid.shape))


def _least(fit: Callable[[float, Fitted], Fitted], given: Fitted, first: float) -> Fitted:
    """Return the fit of the strength whose error is least; ``given`` has none of it.

    Strengths are doubled from ``first`` on while the error falls, then refined by parabolas.
    """
    tried, strength = {0.0: given}, first
    for _ in range(DOUBLINGS + 1):
        near = tried[max(tried)]
        tried[strength] = fit(strength, near)
        if tried[strength].error >= near.error:
            break
        strength *= 2
    for _ in range(REFINEMENTS):
        best = min(tried, key=lambda one: tried[one].error)
        lower, upper = ([s for s in tried if s < best], [s for s in tried if s > best])
        if not (lower and upper):
            break
        around = max(lower), best, min(upper)
        vertex = _vertex(around, tuple(tried[one].error for one in around))
        if not around[0] < vertex < around[2] or vertex in tried:
            break
        tried[vertex] = fit(vertex, tried[best])
    return min(tried.values(), key=lambda one: one.error)


def _vertex(at: tuple[float, ...], value: tuple[float, ...]) -> float:
    """Return where the parabola through three points is least."""
    square, slope, _ = np.polyfit(np.array(at) - at[1], value, 2)
    return float(at[1] - slope / (2 * square)) if square > 0 else at[1]
