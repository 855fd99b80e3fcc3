"""How far a volume hangs on a few of its cameras: a delete-a-group jackknife over views."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from tomo.operators import LinearSystem
from tomo.operators.system import Progress

GROUPS = 3
"""Groups of views at most. Fewer see too little of what each view adds, more cost a solve each:
six are fair in 75 of 100 scenes, three in 70."""

FEWEST = 3
"""Views with pixels below which none can be left out."""


class Resolve(Protocol):
    """The chosen method, with its smoothness and iterations, as a function of the pixels."""

    def __call__(
        self, measured: NDArray[np.float32], views: Sequence[int] | None = None
    ) -> NDArray[np.float32]:
        """Return the unknowns ``(unknowns,)`` from all pixels, or from those of some views."""


@dataclass(frozen=True, eq=False)
class Jackknife:
    """The volumes of a reconstruction without one group of views each.

    Attributes
    ----------
    groups : list of list of int
        The views that each went without.
    volumes : (groups, unknowns) float32
    """

    groups: list[list[int]]
    volumes: NDArray[np.float32]

    def deviation(self, whole: NDArray, parts: NDArray) -> NDArray[np.float64]:
        """Return the jackknife's standard deviation of a quantity, ``(...,)``.

        Parameters
        ----------
        whole : (...,)
            The quantity of all views.
        parts : (groups, ...)
            The quantity without each group.

        Notes
        -----
        ``sqrt((G - 1) / G sum_g (q_g - q)²)`` (Efron and Tibshirani, "An Introduction to the
        Bootstrap", 1993, chapter 11), about the value of all views instead of the mean: what all
        groups move in one direction is an error too.
        """
        count = len(parts)
        squares = np.square(np.subtract(parts, whole, dtype=np.float64)).sum(axis=0)
        return np.sqrt((count - 1) / count * squares)


def jackknife(
    system: LinearSystem,
    measured: NDArray[np.float32],
    solve: Resolve,
    progress: Progress | None = None,
) -> Jackknife | None:
    """Solve without each of some groups of views; None where there are too few views.

    Parameters
    ----------
    system : LinearSystem
    measured : (pixels,) float32
    solve : callable
        The reconstruction, from all views or some.
    progress : callable, optional
    """
    groups = view_groups(system)
    if not groups:
        return None
    volumes = []
    for number, group in enumerate(groups):
        if progress:
            progress(number, len(groups), "intervals: without some cameras")
        kept = sorted(view for other in groups if other is not group for view in other)
        volumes.append(solve(measured, kept))
    if progress:
        progress(len(groups), len(groups), "intervals: without some cameras")
    return Jackknife(groups, np.stack(volumes).astype(np.float32, copy=False))


def view_groups(system: LinearSystem) -> list[list[int]]:
    """Return groups of the views that have pixels; none where these are fewer than `FEWEST`.

    Neighbours are in different groups, so that a group goes all round and leaves no gap of its
    own.
    """
    views = system.projector.views_with_pixels.tolist()
    if len(views) < FEWEST:
        return []
    count = min(GROUPS, len(views))
    return [views[number::count] for number in range(count)]
