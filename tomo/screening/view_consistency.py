"""A consistency test of the views: images that contradict what the other cameras saw.

Each view is predicted from subsets of the other views. Its image is compared with the best
prediction that it took no part in. Small pointing errors, gains, haze, blur and noise lower that
agreement a little and in all views alike. An image of another frame, camera or flame, or a
flipped image, lowers it in one view alone.
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
"""Views. Fewer predict each other too poorly to find the inconsistent one."""

SHIFT = 3.0
"""Pixels by which every camera may point wrongly without being suspicious."""

FAR_SHIFT, FARTHEST = 0.1, 3
"""Pointing error allowed to a suspicious view before it is excluded: a fraction of the image's
shorter side, and at most so many coarse pixels."""

SUSPICIOUS = (2.5, 4.0, 0.004)
INCONSISTENT = (4.0, 8.0, 0.03)
INCONSISTENT_FEW_VIEWS = (4.0, 8.0, 0.12)
"""Limits of a view's disagreement: times the others' median, standard deviations above it, and
an absolute least value. Suspicious views are tested closely, inconsistent ones excluded. Few
views predict each other less well, hence the higher limit."""

FEW_VIEWS = 12
"""Views up to which `INCONSISTENT_FEW_VIEWS` holds."""

FLIPPED = 0.45
"""A suspicious view is inconsistent where flipping its image leaves at most this fraction of its
disagreement, and no more than the other views may have."""

EXCHANGED = 0.6
"""The same for the summed disagreement of two views whose images are exchanged."""

SIMPLER = 1.5
"""A flip is preferred to an exchanged camera unless the exchange leaves so many times less:
opposite cameras see mirror images."""

TILTS = (-4.0, -2.0, 2.0, 4.0)
"""Degrees about its axis that a suspicious camera may be turned before it is excluded."""

UNINFORMATIVE = 0.03
"""A view is not tested where its predictions vary by less than this fraction of the median's."""

MOST_INCONSISTENT = 1 / 3
"""Fraction of the views. Where more are inconsistent, none is excluded: the test cannot tell
which are right."""


@dataclass(frozen=True)
class ViewConsistency:
    """The result of the consistency test for one view.

    Attributes
    ----------
    name : str
        The camera's.
    agreement : float
        Correlation of its image with the best prediction; NaN where it was not tested.
    others : (float, float)
        The range of the consistent views' agreement.
    inconsistent : bool
    looks : str
        What its image looks like instead, in words; empty where no hypothesis fits.
    """

    name: str
    agreement: float
    others: tuple[float, float]
    inconsistent: bool = False
    looks: str = ""

    def report(self) -> dict[str, Any]:
        """Return plain numbers and words."""
        return {
            "agreement": self.agreement,
            "inconsistent": self.inconsistent,
            "looks": self.looks or None,
        }

    def in_words(self) -> str:
        """Return the finding on an inconsistent view as a line, without what is done about it."""
        low, high = self.others
        looks = f"; it {self.looks}" if self.looks else ""
        return (
            f"camera {self.name}: its image contradicts the other views (correlation with their "
            f"prediction {self.agreement:.3f}, other cameras {low:.3f} to {high:.3f}){looks}"
        )


def check_consistency(
    rig: Rig,
    images: Sequence[NDArray[np.float32]],
    masks: Sequence[NDArray[np.bool_]],
    grid: VoxelGrid,
    *,
    trusted: int | None = None,
) -> tuple[ViewConsistency, ...]:
    """Test every view against the others; an empty result where there are too few views.

    Parameters
    ----------
    rig : Rig
    images, masks : sequence of (height, width)
        One a camera; the masks are True where a pixel is usable.
    grid : VoxelGrid
    trusted : int, optional
        Only the first so many cameras predict others; the rest are tested only. All when None.

    Raises
    ------
    tomo.operators.system.VolumeNotSeenError
        If no usable pixel sees the grid.
    """
    trusted = len(rig) if trusted is None else trusted
    lit = any(np.any(i > 0, where=m) for i, m in zip(images, masks, strict=True))
    if trusted < FEWEST_VIEWS or not lit:
        return ()
    test = _ConsistencyTest(rig.names, Predictions.of(rig, images, masks, grid, trusted), trusted)
    return test.results()


_LIKE = "looks like camera {}'s"


@dataclass(frozen=True)
class _Hypothesis:
    """What an image may be instead: the disagreement then left, words, whose image it is."""

    disagreement: float
    words: str
    other: int | None = None


@dataclass(frozen=True, eq=False)
class _ConsistencyTest:
    """Tests views by their disagreement, 1 less the agreement, one number a view.

    Attributes
    ----------
    names : tuple of str
    seen : Predictions
    trusted : int
        The first so many views predict others; the rest are tested only.
    """

    names: tuple[str, ...]
    seen: Predictions
    trusted: int

    def results(self) -> tuple[ViewConsistency, ...]:
        """Return the result for each view."""
        disagreement = self.disagreements()
        suspicious = [
            v for v in range(len(self.names)) if self._stands_out(disagreement, v, SUSPICIOUS)
        ]
        found: dict[int, str] = {}
        if suspicious:
            difficulty = self._difficulty(suspicious)
            disagreement = disagreement / difficulty
            for view in suspicious:
                disagreement[view] = self._least_disagreement(view) / difficulty[view]
            found = self._inconsistent(disagreement, difficulty, suspicious)
        if sum(view < self.trusted for view in found) > MOST_INCONSISTENT * self.trusted:
            found = {}
        others = self._range_of_agreement(disagreement, found)
        return tuple(
            ViewConsistency(name, float(1 - disagreement[v]), others, v in found, found.get(v, ""))
            for v, name in enumerate(self.names)
        )

    def _inconsistent(
        self,
        disagreement: NDArray[np.float64],
        difficulty: NDArray[np.float64],
        suspicious: Sequence[int],
    ) -> dict[int, str]:
        """Return the inconsistent views among the suspicious, and what each looks like."""
        found: dict[int, str] = {}
        limits = INCONSISTENT if self.trusted > FEW_VIEWS else INCONSISTENT_FEW_VIEWS
        for view in suspicious:
            if view in found or not self._stands_out(disagreement, view, SUSPICIOUS):
                continue
            best = self._best_hypothesis(view)
            read = disagreement.copy()
            read[view] = best.disagreement / difficulty[view]
            fits = read[view] < EXCHANGED * disagreement[view]
            fits &= not self._stands_out(read, view, SUSPICIOUS)
            flipped = best.other is None and read[view] < FLIPPED * disagreement[view]
            exchanged = best.other is not None and fits and self._exchanged(view, best)
            if exchanged:
                found[best.other] = _LIKE.format(self.names[view])
            if exchanged or (fits and flipped):
                found[view] = best.words
            elif self._stands_out(disagreement, view, limits):
                found[view] = best.words if fits else ""
        return found

    def _exchanged(self, view: int, hypothesis: _Hypothesis) -> bool:
        """Return whether two views look like each other's image."""
        other = hypothesis.other
        own = self._least_disagreement(other)
        there = self.disagreement(self.seen.images[other], view, self._far(other))
        together = hypothesis.disagreement + there < EXCHANGED * (
            self._least_disagreement(view) + own
        )
        return together and there < own

    def disagreement(self, image: NDArray, of: int, reach: int) -> float:
        """Return 1 less the best agreement of an image with the predictions of a view."""
        mask = self.seen.masks[of]
        return 1 - agreement(self.seen.of_view(of), image, mask, reach)

    def disagreements(self) -> NDArray[np.float64]:
        """Return every view's disagreement, ``(views,)``; NaN where it is not tested."""
        reach = math.ceil(SHIFT / self.seen.factor)
        images = self.seen.images
        disagreement = np.array(
            [self.disagreement(image, view, reach) for view, image in enumerate(images)]
        )
        disagreement[self._uninformative()] = np.nan
        return disagreement

    def _least_disagreement(self, view: int) -> float:
        """Return the least disagreement over small shifts and turns of the camera."""
        image, reach = self.seen.images[view], self._far(view)
        tilted = [rotate(image, tilt, reshape=False, order=1, mode="nearest") for tilt in TILTS]
        return min(self.disagreement(one, view, reach) for one in (image, *tilted))

    def _far(self, view: int) -> int:
        """Return the shift, in coarse pixels, that a suspicious view is allowed."""
        far = math.ceil(FAR_SHIFT * min(self.seen.images[view].shape))
        return max(math.ceil(SHIFT / self.seen.factor), min(far, FARTHEST))

    def _difficulty(self, suspicious: Sequence[int]) -> NDArray[np.float64]:
        """Return how much harder each view is to predict than the median view, at least 1."""
        good = [view for view in range(self.trusted) if view not in suspicious]
        if not good:
            return np.ones(len(self.names))
        bootstrap = replace(self, seen=self.seen.bootstrapped(good)).disagreements()
        typical = np.nanmedian(bootstrap[good]) if np.isfinite(bootstrap[good]).any() else 0.0
        if not typical > 0:
            return np.ones(len(self.names))
        return np.maximum(np.nan_to_num(bootstrap / typical, nan=1.0), 1.0)

    def _uninformative(self) -> NDArray[np.bool_]:
        """Return the views whose predictions are nearly constant, ``(views,)``."""
        varies = []
        for view, mask in enumerate(self.seen.masks):
            spreads = [
                np.std(p[mask], dtype=np.float64) if mask.any() else 0.0
                for p in self.seen.of_view(view)
            ]
            varies.append(float(np.median(spreads)))
        return np.array(varies) < UNINFORMATIVE * np.median(varies)

    def _stands_out(
        self, disagreement: NDArray[np.float64], view: int, limits: tuple[float, float, float]
    ) -> bool:
        """Return whether a view disagrees far more than the trusted others do."""
        others = [
            disagreement[v]
            for v in range(self.trusted)
            if v != view and not math.isnan(disagreement[v])
        ]
        if math.isnan(disagreement[view]) or len(others) < FEWEST_VIEWS - 1:
            return False
        middle = float(np.median(others))
        spread = 1.4826 * float(np.median(np.abs(np.array(others) - middle)))
        times, deviations, least = limits
        return bool(disagreement[view] > max(times * middle, middle + deviations * spread, least))

    def _range_of_agreement(
        self, disagreement: NDArray[np.float64], found: Mapping[int, str]
    ) -> tuple[float, float]:
        """Return the lowest and highest agreement of the consistent trusted views."""
        found = [1 - disagreement[v] for v in range(self.trusted) if v not in found]
        found = [one for one in found if not math.isnan(one)]
        return (float(min(found)), float(max(found))) if found else (math.nan, math.nan)

    def _best_hypothesis(self, view: int) -> _Hypothesis:
        """Return the hypothesis that fits best: a flipped image, or another camera's."""
        image, reach = self.seen.images[view], self._far(view)
        turned = {
            "looks mirrored left to right": image[:, ::-1],
            "looks upside down": image[::-1],
            "looks turned by 180 degrees": image[::-1, ::-1],
        }
        if image.shape[0] == image.shape[1]:
            turned["looks turned by 90 degrees"] = np.rot90(image)
            turned["looks turned by 270 degrees"] = np.rot90(image, 3)
        hypotheses = [
            _Hypothesis(self.disagreement(one, view, reach), w) for w, one in turned.items()
        ]
        simplest = min(hypotheses, key=lambda hypothesis: hypothesis.disagreement)
        for other, name in enumerate(self.names):
            if other != view and self.seen.images[other].shape == image.shape:
                found = self.disagreement(image, other, reach)
                if not math.isnan(found):
                    hypotheses.append(_Hypothesis(found, _LIKE.format(name), other))
        best = min(hypotheses, key=lambda hypothesis: hypothesis.disagreement)
        return simplest if simplest.disagreement <= SIMPLER * best.disagreement else best
