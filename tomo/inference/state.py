"""How far an inference came: the fits, the effects found so far, and what they cost."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from tomo.inference.fit import Fit
from tomo.inference.left_out import squared_errors
from tomo.inference.solve import Values
from tomo.model.effect import Effect
from tomo.model.observation import Observation

OUTSIDE, HIDDEN = "outside", "hidden"
"""Scores of light from around the grid, and of pixels that nothing explains."""


@dataclass(frozen=True, eq=False)
class State:
    """How far the inference came.

    There is a fit a frame. ``values`` (views, parameters) are of the effects so far, common to
    all frames; ``free`` are those that were let loose; ``hidden`` (views,) the views of which
    pixels are left out that nothing explains. ``is_dark_around``: backgrounds explain what
    light from around the grid would.
    """

    fits: tuple[Fit, ...]
    values: Values
    free: Mapping[str, NDArray[np.bool_]]
    hidden: NDArray[np.bool_]
    is_dark_around: bool = False

    @property
    def has_outside(self) -> bool:
        """Whether voxels around the grid were let loose."""
        return self.fits[0].around is not None

    def looser_than(self, before: State) -> set[str]:
        """Return the names of what is loose here and was not, as scores have them."""
        names = {n for n, free in self.free.items() if (free & ~before.free[n]).any()}
        names |= {HIDDEN} if (self.hidden & ~before.hidden).any() else set()
        around = self.has_outside or self.is_dark_around
        names |= (
            {OUTSIDE} if around and not (before.has_outside or before.is_dark_around) else set()
        )
        return names

    def views_looser_than(self, before: State) -> NDArray[np.intp]:
        """Return how many effects are loose in each view that were not, ``(views,)``.

        Those that most views have are left out: they are no doubt about one.
        """
        now = [(free & ~before.free[n]).any(axis=1) for n, free in self.free.items()]
        now.append(self.hidden & ~before.hidden)
        return np.sum([one for one in now if one.mean() <= 0.5], axis=0, dtype=np.intp)

    @cached_property
    def left_out_errors(self) -> NDArray[np.float64]:
        """The squared errors of left-out pixels, ``(pixels,)``: see `squared_errors`."""
        return squared_errors(self.fits)

    def takes_part(self, view: int) -> bool:
        """Return whether any pixel of a view is used."""
        own = slice(*self.fits[0].system.projector.view_ptr[view : view + 2])
        return bool(self.fits[0].usable[own].any())

    @property
    def scales(self) -> tuple[float, ...]:
        """The scale of every frame's smoothed residuals."""
        return tuple(fit.scale for fit in self.fits)

    def loosened(self, name: str, views: NDArray[np.bool_]) -> State:
        """Return the state with an effect let loose, all usable pixels of its views trusted."""
        free = {n: f.copy() for n, f in self.free.items()}
        free[name] |= views[:, None]
        return replace(self, free=free, fits=tuple(fit.trusting(views) for fit in self.fits))

    def cost(
        self, scales: Iterable[float], effects: Sequence[Effect], deviations: Values
    ) -> float:
        """Return the disagreement that is left, and the price of the effects by their priors."""
        cost = sum(fit.disagreement(own) for fit, own in zip(self.fits, scales, strict=True))
        for effect in effects:
            ratio = self.values[effect.name] / deviations[effect.name]
            if effect.field_of is None:
                cost += float(np.square(ratio).sum())
            else:  # exponential, of each node once
                cost += 2 * float(ratio[0].sum())
        return cost


def corrected(
    observations: Sequence[Observation], effects: Sequence[Effect], values: Values
) -> list[Observation]:
    """Return the observations without the effects."""
    found = list(observations)
    for effect in effects:
        if values[effect.name].any():
            found = [effect.applied(one, values[effect.name]) for one in found]
    return found
