"""Wrong views: images that the other cameras cannot have seen the same volume in.

A view is predicted from parties of the others, and the best of the predictions that it takes no
part in is compared with its image. Cameras that look a little beside, gains, haze, blur and noise
lower that agreement by little, and alike in all views; the image of another moment, camera or
flame, or one that was turned over, lowers it in one view alone.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import rotate

from rigs import Rig
from tomo.grid import VoxelGrid
from tomo.screening.agreement import agreement
from tomo.screening.left_out_prediction import Predictions

FEWEST_VIEWS = 5
"""Fewer views predict each other too poorly to tell which one is wrong."""

SLIP = 3.0
"""Pixels that any camera may look beside."""

FAR_SLIP, FARTHEST = 0.1, 3
"""Of the image's shorter side, and in large pixels at most: what a suspected view may look beside
before it is doubted."""

SUSPECT = (2.5, 4.0, 0.004)
WRONG = (4.0, 8.0, 0.03)
WRONG_OF_FEW = (4.0, 8.0, 0.12)
"""How far a view lacks agreement: times what the others lack, their standard deviations above
that, and at least so much. Suspects are looked at closely; wrong views are left out. Few views
predict each other less well."""

FEW_VIEWS = 12

TURNED_OVER = 0.45
"""A suspect is wrong too where turning its image over leaves at most this share of what it lacks,
and no more than the other views may lack."""

EXCHANGED = 0.6
"""The same of what two views lack together, once their images are exchanged."""

SIMPLER = 1.5
"""That an image was turned over is believed before it is another camera's, unless that leaves so
many times less: opposite cameras see mirror images."""

TILTS = (-4.0, -2.0, 2.0, 4.0)
"""Degrees that a suspect's camera may be turned about its axis before it is doubted."""

FAINT = 0.03
"""A view says nothing whose predictions vary by less than this share of the typical view's."""

MOST_WRONG = 1 / 3
"""Of the views: where more contradict the others, there is no telling who is right."""


@dataclass(frozen=True)
class ViewVerdict:
    """What the other views say of one.

    Attributes
    ----------
    name : str
        The camera's.
    agreement : float
        Correlation of its image with the best prediction; NaN where nothing can be said.
    others : (float, float)
        The range of the other views' agreement, wrong ones left aside.
    wrong : bool
    looks : str
        What its image looks like instead, in words; empty where nothing fits.
    """

    name: str
    agreement: float
    others: tuple[float, float]
    wrong: bool = False
    looks: str = ""

    def report(self) -> dict[str, Any]:
        """Return plain numbers and words."""
        return {"agreement": self.agreement, "wrong": self.wrong, "looks": self.looks or None}

    def in_words(self) -> str:
        """Return the line of a wrong view, without what is done about it."""
        low, high = self.others
        looks = f"; it {self.looks}" if self.looks else ""
        return (
            f"camera {self.name}: its image agrees with what the other views predict only to "
            f"{self.agreement:.3f} (theirs {low:.3f} to {high:.3f}){looks}"
        )


def judge_views(
    rig: Rig,
    images: Sequence[NDArray[np.float32]],
    masks: Sequence[NDArray[np.bool_]],
    grid: VoxelGrid,
    *,
    trusted: int | None = None,
) -> tuple[ViewVerdict, ...]:
    """Judge every view by the others; none where there are too few to tell.

    Parameters
    ----------
    rig : Rig
    images, masks : sequence of (height, width)
        One a camera; the masks are True where a pixel is usable.
    grid : VoxelGrid
    trusted : int, optional
        The cameras after the first so many are judged and judge nobody; all judge when None.

    Raises
    ------
    tomo.operators.system.VolumeNotSeenError
        If no usable pixel sees the grid.
    """
    trusted = len(rig) if trusted is None else trusted
    lit = any(np.any(i > 0, where=m) for i, m in zip(images, masks, strict=True))
    if trusted < FEWEST_VIEWS or not lit:
        return ()
    court = _Court(rig.names, Predictions.of(rig, images, masks, grid, trusted), trusted)
    return court.verdicts()


_LIKE = "looks like camera {}'s"


@dataclass(frozen=True)
class _Reading:
    """What else an image may be: what then lacks of its agreement, in words, and whose it is."""

    lack: float
    words: str
    other: int | None = None


@dataclass(frozen=True, eq=False)
class _Court:
    """Judges views by what their agreement lacks of 1, one number a view: ``lack``.

    Attributes
    ----------
    names : tuple of str
    seen : Predictions
    trusted : int
        The first so many views judge; the others are judged only.
    """

    names: tuple[str, ...]
    seen: Predictions
    trusted: int

    def verdicts(self) -> tuple[ViewVerdict, ...]:
        """Return what is said of each view."""
        lack = self.lacks()
        suspects = [v for v in range(len(self.names)) if self._stands_out(lack, v, SUSPECT)]
        wrong: dict[int, str] = {}
        if suspects:
            harder = self._harder(suspects)
            lack = lack / harder
            for view in suspects:
                lack[view] = self._least_lack(view) / harder[view]
            wrong = self._found_wrong(lack, harder, suspects)
        if sum(view < self.trusted for view in wrong) > MOST_WRONG * self.trusted:
            wrong = {}
        others = self._range_of_agreement(lack, wrong)
        return tuple(
            ViewVerdict(name, float(1 - lack[v]), others, v in wrong, wrong.get(v, ""))
            for v, name in enumerate(self.names)
        )

    def _found_wrong(
        self, lack: NDArray[np.float64], harder: NDArray[np.float64], suspects: Sequence[int]
    ) -> dict[int, str]:
        """Return the wrong ones among suspects, and what they look like instead, in words."""
        wrong: dict[int, str] = {}
        limits = WRONG if self.trusted > FEW_VIEWS else WRONG_OF_FEW
        for view in suspects:
            if view in wrong or not self._stands_out(lack, view, SUSPECT):
                continue
            best = self._best_reading(view)
            read = lack.copy()
            read[view] = best.lack / harder[view]
            fits = read[view] < EXCHANGED * lack[view]
            fits &= not self._stands_out(read, view, SUSPECT)
            turned_over = best.other is None and read[view] < TURNED_OVER * lack[view]
            exchanged = best.other is not None and fits and self._exchanged(view, best)
            if exchanged:
                wrong[best.other] = _LIKE.format(self.names[view])
            if exchanged or (fits and turned_over):
                wrong[view] = best.words
            elif self._stands_out(lack, view, limits):
                wrong[view] = best.words if fits else ""
        return wrong

    def _exchanged(self, view: int, reading: _Reading) -> bool:
        """Return whether a view and the one that it reads as are like each other's image."""
        other = reading.other
        own = self._least_lack(other)
        there = self.lack(self.seen.images[other], view, self._far(other))
        together = reading.lack + there < EXCHANGED * (self._least_lack(view) + own)
        return together and there < own

    def lack(self, image: NDArray, of: int, reach: int) -> float:
        """Return 1 less the best agreement of an image with what is predicted of a view."""
        mask = self.seen.masks[of]
        return 1 - agreement(self.seen.of_view(of), image, mask, reach)

    def lacks(self) -> NDArray[np.float64]:
        """Return every view's, ``(views,)``; NaN where nothing shows."""
        reach = math.ceil(SLIP / self.seen.factor)
        images = self.seen.images
        lack = np.array([self.lack(image, view, reach) for view, image in enumerate(images)])
        lack[self._silent()] = np.nan
        return lack

    def _least_lack(self, view: int) -> float:
        """Return what is lacking however the camera is shifted and turned a little."""
        image, reach = self.seen.images[view], self._far(view)
        tilted = [rotate(image, tilt, reshape=False, order=1, mode="nearest") for tilt in TILTS]
        return min(self.lack(one, view, reach) for one in (image, *tilted))

    def _far(self, view: int) -> int:
        """Return the shifts, in large pixels, that a suspect is allowed."""
        far = math.ceil(FAR_SLIP * min(self.seen.images[view].shape))
        return max(math.ceil(SLIP / self.seen.factor), min(far, FARTHEST))

    def _harder(self, suspects: Sequence[int]) -> NDArray[np.float64]:
        """Return by how much each view is harder to predict than the others, at least 1."""
        good = [view for view in range(self.trusted) if view not in suspects]
        if not good:
            return np.ones(len(self.names))
        rehearsal = replace(self, seen=self.seen.rehearsed(good)).lacks()
        typical = np.nanmedian(rehearsal[good]) if np.isfinite(rehearsal[good]).any() else 0.0
        if not typical > 0:
            return np.ones(len(self.names))
        return np.maximum(np.nan_to_num(rehearsal / typical, nan=1.0), 1.0)

    def _silent(self) -> NDArray[np.bool_]:
        """Return the views of which next to nothing is predicted."""
        varies = []
        for view, mask in enumerate(self.seen.masks):
            spreads = [
                np.std(p[mask], dtype=np.float64) if mask.any() else 0.0
                for p in self.seen.of_view(view)
            ]
            varies.append(float(np.median(spreads)))
        return np.array(varies) < FAINT * np.median(varies)

    def _stands_out(
        self, lack: NDArray[np.float64], view: int, limits: tuple[float, float, float]
    ) -> bool:
        """Return whether a view lacks far more than the trusted others do."""
        others = [lack[v] for v in range(self.trusted) if v != view and not math.isnan(lack[v])]
        if math.isnan(lack[view]) or len(others) < FEWEST_VIEWS - 1:
            return False
        middle = float(np.median(others))
        spread = 1.4826 * float(np.median(np.abs(np.array(others) - middle)))
        times, deviations, least = limits
        return bool(lack[view] > max(times * middle, middle + deviations * spread, least))

    def _range_of_agreement(
        self, lack: NDArray[np.float64], wrong: Mapping[int, str]
    ) -> tuple[float, float]:
        """Return the lowest and highest agreement of trusted views that are not wrong."""
        found = [1 - lack[v] for v in range(self.trusted) if v not in wrong]
        found = [one for one in found if not math.isnan(one)]
        return (float(min(found)), float(max(found))) if found else (math.nan, math.nan)

    def _best_reading(self, view: int) -> _Reading:
        """Return what fits best: that the image was turned over, or is another camera's."""
        image, reach = self.seen.images[view], self._far(view)
        turned = {
            "looks mirrored left to right": image[:, ::-1],
            "looks upside down": image[::-1],
            "looks turned by 180 degrees": image[::-1, ::-1],
        }
        if image.shape[0] == image.shape[1]:
            turned["looks turned by 90 degrees"] = np.rot90(image)
            turned["looks turned by 270 degrees"] = np.rot90(image, 3)
        readings = [_Reading(self.lack(one, view, reach), w) for w, one in turned.items()]
        simplest = min(readings, key=lambda reading: reading.lack)
        for other, name in enumerate(self.names):
            if other != view and self.seen.images[other].shape == image.shape:
                found = self.lack(image, other, reach)
                if not math.isnan(found):
                    readings.append(_Reading(found, _LIKE.format(name), other))
        best = min(readings, key=lambda reading: reading.lack)
        return simplest if simplest.lack <= SIMPLER * best.lack else best
