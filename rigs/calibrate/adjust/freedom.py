"""Which unknowns of the cameras are adjusted, and which of them are one number."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

NUMBERS = ("wx", "wy", "wz", "tx", "ty", "tz", "fx", "fy", "cx", "cy")
"""A camera's first numbers: rotation vector (multiplied from the left), translation, its lens."""

FX, FY = NUMBERS.index("fx"), NUMBERS.index("fy")


@dataclass(frozen=True, eq=False)
class Freedom:
    """Which unknowns are free, and which are shared; the target poses always are free.

    A camera's numbers are `NUMBERS`, the coefficients of its distortion, the moment of its images,
    and last those of the scene's windows, which all share.

    >>> import numpy as np
    >>> Freedom((np.arange(4) < 2,) * 2, np.array([False, True]), square=True, common=(0, 0)).size
    7
    """

    lens: tuple[NDArray[np.bool_], ...]  # each camera's fx, fy, cx, cy and coefficients
    pose: NDArray[np.bool_]  # (cameras,)
    time: NDArray[np.bool_] | None = None  # (cameras,) the moment of its images; held without
    square: bool = False  # fx and fy change by one number: square pixels stay square
    common: tuple[int, ...] | None = None  # as of `LensRules`
    windows: NDArray[np.bool_] | None = None  # (n,) numbers of windows, see `Refraction`

    @cached_property
    def places(self) -> tuple[NDArray[np.int64], ...]:
        """For each camera the place of its numbers among all free parameters; -1 where held."""
        found: list[NDArray[np.int64]] = []
        count = 0
        for camera, lens in enumerate(self.lens):
            is_timed = self.time is not None and self.time[camera]
            free = np.r_[np.repeat(self.pose[camera], 6), lens, is_timed]
            place = np.full(len(free), -1)
            first = camera if self.common is None else self.common[camera]
            if first != camera:
                place[6 : 6 + len(lens)] = found[first][6 : 6 + len(lens)]
                free[6 : 6 + len(lens)] = False
            elif self.square and free[FX] and free[FY]:
                free[FY] = False
            place[free] = count + np.arange(int(free.sum()))
            count += int(free.sum())
            if first == camera and self.square and lens[FY - 6]:
                place[FY] = place[FX]
            found.append(place)
        windows = np.zeros(0, bool) if self.windows is None else self.windows
        shared = np.where(windows, count - 1 + np.cumsum(windows), -1)
        return tuple(np.r_[place, shared] for place in found)

    @cached_property
    def window_places(self) -> NDArray[np.int64]:
        """The place of each number of windows among all free parameters; -1 where held."""
        count = 0 if self.windows is None else len(self.windows)
        return self.places[0][len(self.places[0]) - count :]

    @cached_property
    def size(self) -> int:
        """Number of free parameters of all cameras."""
        return max((int(place.max(initial=-1)) for place in self.places), default=-1) + 1

    def gathered(
        self, camera: int, by_camera: NDArray[np.float64]
    ) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
        """Return the parameters that move a camera ``(k,)``, and derivatives by them ``(..., k)``.

        ``by_camera`` ``(..., m)`` are those by the camera's numbers, zero beyond m.
        """
        place = self.places[camera]
        free = np.flatnonzero(place >= 0)
        own, column = np.unique(place[free], return_inverse=True)
        into = np.zeros((by_camera.shape[-1], len(own)))
        within = free < by_camera.shape[-1]
        into[free[within], column[within]] = 1
        return own, by_camera @ into

    def step(self, camera: int, change: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return a camera's numbers' changes where the parameters change by ``change``."""
        return _spread(self.places[camera], change)

    def window_step(self, change: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the changes of the windows' numbers where the parameters change by ``change``."""
        return _spread(self.window_places, change)

    def freed_in(self, other: Freedom) -> NDArray[np.bool_]:
        """Return which parameters are free in ``other`` too, whose lenses may be shorter."""
        free = np.zeros(self.size, bool)
        for place, inner in zip(self.places, other.places, strict=True):
            after = 1 + (0 if self.windows is None else len(self.windows))  # moment and windows
            wide = np.zeros(len(place), bool)
            wide[: len(inner) - after], wide[-after:] = inner[:-after] >= 0, inner[-after:] >= 0
            free[place[wide & (place >= 0)]] = True
        return free


def _spread(place: NDArray[np.int64], change: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the change of each number from those of all free parameters; 0 where held."""
    return np.where(place >= 0, np.r_[change, 0.0][place], 0.0)
