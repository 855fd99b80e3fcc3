"""The smallest margin at which views do not contradict each other and faint light stays."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tomo.hull.dark_votes import dark_votes, touched
from tomo.hull.darkness import Brightness
from tomo.hull.projection_lattice import STEP, Lattice

VIEWS_A_VOTE = 6
"""Views for which one vote more is needed."""

UNEXPLAINED = 1e-3
"""Largest fraction of a view's bright light that may meet no active voxel; noise and rounding
make less, cameras that disagree more."""

MARGINS = (0, 1, 2, 3, 4, 5, 6, 8, 10, 13, 16, 20, 26, 32)
"""Margins tried, in pixels."""

WIDEST_MARGIN = 0.1  # fraction of the smallest image's shorter side

CARVED_AWAY = 0.005
"""Largest fraction of all light that may meet no active voxel: faint light around a bright core is
part of the flame. Lower: noise and the tails of every flame count."""


@dataclass(frozen=True, eq=False)
class Hull:
    """The voxels that the votes leave active at a margin, and the light then unexplained."""

    margin: float
    active: NDArray[np.bool_]  # (nx, ny, nz)
    explained: list[NDArray[np.bool_]]  # (height, width) each: pixels that see an active voxel
    missed: float  # largest fraction, over views, of bright light that meets no active voxel
    carved_away: float  # fraction of all light, however faint, that meets none

    @property
    def keeps_the_light(self) -> bool:
        """Whether no more light is unexplained than noise and rounding make."""
        return self.missed <= UNEXPLAINED and self.carved_away <= CARVED_AWAY


@dataclass(frozen=True, eq=False)
class Hulls:
    """The hulls of a set of views, by margin and votes.

    ``beyond``: see `tomo.hull.dark_votes.dark_votes`.
    """

    lattices: list[Lattice]
    brightness: Brightness
    voters: list[int]
    shape: tuple[int, int, int]
    beyond: bool = False

    @cached_property
    def seen(self) -> list[NDArray[np.bool_]]:
        """The pixels that any voxel touches; computed on demand: it takes as long as a hull."""
        return touched(np.ones(self.shape, bool), self.lattices, self._image_shapes)

    @property
    def bright(self) -> bool:
        """Whether a voting view certainly sees light in the grid."""
        certain = self.brightness.certain
        if any(certain[view][self._at_corners(view)].any() for view in self.voters):
            return True
        return any((certain[view] & self.seen[view]).any() for view in self.voters)

    def at(self, margin: float, enough: int) -> Hull:
        """Return the hull in which ``enough`` views find every carved voxel dark."""
        bright = [self.brightness.bright[view] for view in self.voters]
        lattices = [self.lattices[view] for view in self.voters]
        how: dict[str, Any] = {"margin": margin, "enough": enough, "beyond": self.beyond}
        active = dark_votes(bright, lattices, self.shape, **how) < enough
        if self.beyond:  # borders say nothing of voxels that no view shows
            nothing = [np.zeros_like(image) for image in bright]
            active |= dark_votes(nothing, lattices, self.shape, margin=0.0, enough=1) == 0
        explained = touched(active, self.lattices, self._image_shapes)
        missed = max(self._missed(view, explained[view]) for view in self.voters)
        return Hull(margin, active, explained, missed, self._carved_away(explained))

    @property
    def _image_shapes(self) -> list[tuple[int, int]]:
        return [image.shape for image in self.brightness.bright]

    def _at_corners(self, view: int) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        """Return the rows and columns of the pixels that see the corners of bricks."""
        inside = tuple(slice(n // STEP + 1) for n in self.shape)
        place = np.floor(self.lattices[view].corners[inside].reshape(-1, 2) + 0.5)
        height, width = self.brightness.bright[view].shape
        place = place[((place >= 0) & (place < (width, height))).all(axis=1)].astype(np.int64)
        return place[:, 1], place[:, 0]

    def _carved_away(self, explained: list[NDArray[np.bool_]]) -> float:
        """Return the fraction of all light in the grid that is unexplained."""
        everything = [np.ones(shape, bool) for shape in self._image_shapes]
        found = self.brightness.carved_away(explained, everything, self.voters)
        if found <= CARVED_AWAY:  # light that misses the grid is in it: an upper bound
            return found
        return self.brightness.carved_away(explained, self.seen, self.voters)

    def _missed(self, view: int, explained: NDArray[np.bool_]) -> float:
        """Return the fraction of a view's certain light in the grid that is unexplained."""
        if not (self.brightness.certain[view] & ~explained).any():
            return 0.0
        return self.brightness.unexplained(view, explained, self.seen[view])


def smallest(
    hull: Hulls, enough: int, margins: list[float], any_will_do: bool
) -> tuple[Hull | None, Hull]:
    """Return the hull of the smallest margin that keeps the light, if any, and the first tried.

    The first margin is tried first, since exact cameras need no other; then by bisection.
    """
    first = hull.at(margins[0], enough)
    if first.keeps_the_light or any_will_do:
        return first, first
    best, low, high = None, 0, len(margins)  # margins[low] fails
    while high - low > 1:
        middle = (low + high) // 2
        found = hull.at(margins[middle], enough)
        if found.keeps_the_light:
            best, high = found, middle
        else:
            low = middle
    return best, first


def votes_to_try(votes: int | str, voters: int) -> list[int]:
    """Return the numbers of views that must agree, the fewest first."""
    if votes != "auto":
        return [int(votes)]
    needed = max(1, round(voters / VIEWS_A_VOTE))
    return list(range(needed, min(needed + 2, voters) + 1))


def margins_to_try(
    margin: float | str, voters: list[int], images: Sequence[NDArray]
) -> list[float]:
    """Return the margins to try, ascending."""
    if margin != "auto":
        return [float(margin)]
    widest = WIDEST_MARGIN * min(min(images[view].shape) for view in voters)
    return [float(m) for m in MARGINS if m <= widest]
