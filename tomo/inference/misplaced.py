"""Images that are turned over, another camera's, or say nothing: causes without a derivative."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from tomo.grid import ActiveVoxels
from tomo.inference.solve import first_fit
from tomo.measurement import NoiseModel
from tomo.measurement.noise_model import SIDE, block_means
from tomo.model.observation import Observation

LIGHT = 4.5
"""Standard deviations of noise above which the brightest block, or all light together, is no
noise: of a thousand blocks of noise one is brighter by 3.3."""


def is_dark(image: NDArray[np.floating], mask: NDArray[np.bool_], noise: NoiseModel) -> bool:
    """Return whether an image has no light: one value all over, or noise alone.

    ``mask`` (height, width) is True where a pixel is usable.
    """
    values = image[mask]
    if not len(values) or values.max() == values.min():
        return True
    dark = float(np.median(values))
    spread = math.sqrt(float(noise.variance(dark)))
    light = np.asarray(values, np.float64) - dark
    means = block_means(np.asarray(image, np.float64), mask) - dark
    brightest = float(means.max(initial=0.0)) * SIDE
    return max(brightest, float(light.sum()) / math.sqrt(light.size)) < LIGHT * spread


def doubles(images: Sequence[NDArray[np.floating]]) -> list[list[int]]:
    """Return the groups of views with the same image, pixel by pixel, that is not dark."""
    groups: list[list[int]] = []
    for view, image in enumerate(images):
        own = next((one for one in groups if np.array_equal(images[one[0]], image)), None)
        if own is None:
            groups.append([view])
        else:
            own.append(view)
    return [one for one in groups if len(one) > 1 and images[one[0]].any()]


BETTER = 0.5
"""Squared error of a prediction over that by the image as it is, from which another orientation,
or another camera's image, is taken for the right one, and an image for that of one camera and not
of another; also that of most other views over a view's own, below which it shows another flame
(`tomo.inference.left_out`)."""

DOUBTED = 0.05
"""Fraction of a view's lit pixels that lost their weight from which it is looked at: an image in
the wrong place agrees with the others hardly anywhere."""

TURNS: Mapping[str, Callable[[NDArray], NDArray]] = {
    "left and right": lambda image: image[:, ::-1],
    "up and down": lambda image: image[::-1],
    "by half a turn": lambda image: image[::-1, ::-1],
}
"""How an image may be turned over."""


@dataclass(frozen=True)
class Misplaced:
    """An image that is not that of its camera as it is.

    ``turned`` is a key of `TURNS`, empty for another camera's image; ``other`` is that camera.
    """

    view: int
    turned: str = ""
    other: int | None = None


def find_misplaced(
    observation: Observation,
    distrust: NDArray[np.float64],
    active: ActiveVoxels | None = None,
) -> Misplaced | None:
    """Return the image in the wrong place, if one of the most doubted views has one.

    ``distrust`` (views,) is the fraction of every view's lit pixels that lost their weight.

    Notes
    -----
    Each doubted view is predicted from the others, and the prediction compared with its image,
    the image turned over, and the images of the other cameras, each with the gain that fits best.
    """
    for view in np.argsort(-distrust, kind="stable")[:2]:
        if distrust[view] < DOUBTED:
            break
        found = _of_view(observation, int(view), active)
        if found is not None:
            return found
    return None


def owner(observation: Observation, views: Sequence[int]) -> int | None:
    """Return which of some ``views`` with the same image it is of; None where nothing tells.

    Each is predicted from the views beside them.
    """
    volume = first_fit(observation.without(*views)).means
    images, masks = observation.images, observation.masks
    errors = {
        view: _error(images[view], _predicted(observation, view, volume), masks[view])
        for view in views
    }
    best, second = sorted(views, key=errors.__getitem__)[:2]
    return best if errors[best] < BETTER * errors[second] else None


def _of_view(observation: Observation, view: int, active: ActiveVoxels | None) -> Misplaced | None:
    """Return what the image of one view is, if not its own."""
    seen = _predicted(observation, view, first_fit(observation.without(view), active).means)
    mask, own = observation.masks[view], observation.images[view]
    least, found = BETTER * _error(own, seen, mask), None
    for words, turn in TURNS.items():
        error = _error(turn(own), seen, mask & turn(mask))
        if error < least:
            least, found = error, Misplaced(view, words)
    for other, image in enumerate(observation.images):
        if other != view and image.shape == own.shape:
            error = _error(image, seen, mask & observation.masks[other])
            if error < least and _suits(observation, view, other, active):
                least, found = error, Misplaced(view, other=other)
    return found


def _suits(observation: Observation, view: int, other: int, active: ActiveVoxels | None) -> bool:
    """Return whether a view's image is more like what another view should show than its own is."""
    volume = first_fit(observation.without(view, other), active).means
    seen, mask = _predicted(observation, other, volume), observation.masks[other]
    own, foreign = observation.images[other], observation.images[view]
    return _error(foreign, seen, mask & observation.masks[view]) < _error(own, seen, mask)


def _predicted(
    observation: Observation, view: int, volume: NDArray[np.float32]
) -> NDArray[np.float64]:
    """Return the image of a volume in one view."""
    from tomo.operators import LinearSystem

    one = replace(observation.rig, cameras=(observation.rig[view],))
    system = LinearSystem.from_rig(one, observation.grid, form="on-the-fly")
    projector = system.projector
    return system.images(projector @ projector.active.compress(volume))[0].astype(np.float64)


def _error(
    image: NDArray[np.floating], seen: NDArray[np.float64], mask: NDArray[np.bool_]
) -> float:
    """Return the squared error of the best multiple of a prediction, over the image's energy."""
    measured, predicted = np.asarray(image, np.float64)[mask], seen[mask]
    energy = float((measured**2).sum())
    if not energy > 0:
        return 1.0
    both = float((measured * predicted).sum())
    return 1 - max(both, 0.0) ** 2 / (energy * max(float((predicted**2).sum()), 1e-300))
