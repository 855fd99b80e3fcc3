"""How far cameras may be off: the smallest margin at which the views do not contradict."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from tomo.hull.dark_votes import dark_votes, touched
from tomo.hull.darkness import Brightness
from tomo.hull.projection_lattice import STEP, Lattice

VIEWS_A_VOTE = 6
"""One more view must agree for every so many views."""

UNEXPLAINED = 1e-3
"""The largest share of the bright pixels' light, in any view, that may meet no active voxel."""

MARGINS = (0, 1, 2, 3, 4, 5, 6, 8, 10, 13, 16, 20, 26, 32)
"""Pixels, those that are tried."""

WIDEST_MARGIN = 0.1  # of the smallest image's shorter side
Found = tuple[float, NDArray[np.bool_], list[NDArray[np.bool_]], float]
"""Margin, active voxels, the pixels that they explain, and the share of light that they do not."""


@dataclass(frozen=True, eq=False)
class Hulls:
    """What the judging views leave active at some margin, and how much that leaves unexplained."""

    lattices: list[Lattice]
    brightness: Brightness
    judges: list[int]
    shape: tuple[int, int, int]

    @cached_property
    def seen(self) -> list[NDArray[np.bool_]]:
        """The pixels that any voxel touches: as long to find as the hull, so only where needed."""
        return touched(np.ones(self.shape, bool), self.lattices, self._image_shapes)

    @property
    def bright(self) -> bool:
        """Whether a judging view surely sees light in the grid."""
        certain = self.brightness.certain
        if any(certain[view][self._at_corners(view)].any() for view in self.judges):
            return True
        return any((certain[view] & self.seen[view]).any() for view in self.judges)

    def at(self, margin: float, enough: int) -> Found:
        """Return what is left where ``enough`` views find what is not active dark."""
        bright = [self.brightness.bright[view] for view in self.judges]
        lattices = [self.lattices[view] for view in self.judges]
        active = dark_votes(bright, lattices, self.shape, margin=margin, enough=enough) < enough
        explained = touched(active, self.lattices, self._image_shapes)
        missed = max(self._missed(view, explained[view]) for view in self.judges)
        return margin, active, explained, missed

    @property
    def _image_shapes(self) -> list[tuple[int, int]]:
        return [image.shape for image in self.brightness.bright]

    def _at_corners(self, view: int) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        """Return the rows and columns of pixels that corners of voxels are seen in."""
        inside = tuple(slice(n // STEP + 1) for n in self.shape)
        place = np.floor(self.lattices[view].corners[inside].reshape(-1, 2) + 0.5)
        height, width = self.brightness.bright[view].shape
        place = place[((place >= 0) & (place < (width, height))).all(axis=1)].astype(np.int64)
        return place[:, 1], place[:, 0]

    def _missed(self, view: int, explained: NDArray[np.bool_]) -> float:
        """Return the share of a view's certain light in the grid that is not explained."""
        if not (self.brightness.certain[view] & ~explained).any():
            return 0.0
        return self.brightness.unexplained(view, explained, self.seen[view])


def smallest(hull: Hulls, enough: int, margins: list[float], any_will_do: bool) -> Found | None:
    """Return the hull of the smallest margin that explains the light; None if none does.

    The first margin is tried first, since exact cameras need no other; then by bisection.
    """
    found = hull.at(margins[0], enough)
    if found[-1] <= UNEXPLAINED or any_will_do:
        return found
    best, low, high = None, 0, len(margins)  # margins[low] fails
    while high - low > 1:
        middle = (low + high) // 2
        found = hull.at(margins[middle], enough)
        if found[-1] <= UNEXPLAINED:
            best, high = found, middle
        else:
            low = middle
    return best


def votes_to_try(votes: int | str, judges: int) -> list[int]:
    """Return the numbers of views that must agree, the fewest first."""
    if votes != "auto":
        return [int(votes)]
    needed = max(1, round(judges / VIEWS_A_VOTE))
    return list(range(needed, min(needed + 2, judges) + 1))


def margins_to_try(
    margin: float | str, judges: list[int], images: Sequence[NDArray]
) -> list[float]:
    """Return the margins to try, ascending."""
    if margin != "auto":
        return [float(margin)]
    widest = WIDEST_MARGIN * min(min(images[view].shape) for view in judges)
    return [float(m) for m in MARGINS if m <= widest]
