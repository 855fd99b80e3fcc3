"""Images that are turned over, or another camera's: causes that have no derivative."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from tomo.grid import ActiveVoxels
from tomo.inference.solve import first_fit
from tomo.model.observation import Observation

BETTER = 0.5
"""Squared error of a prediction over that by the image as it is, from which another orientation,
or another camera's image, is taken for the right one."""

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

    Attributes
    ----------
    view : int
    turned : str
        A key of `TURNS`; empty for another camera's image.
    other : int, optional
        The camera whose image it is.
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

    Parameters
    ----------
    observation : Observation
    distrust : (views,) float64
        The fraction of every view's lit pixels that lost their weight.
    active : ActiveVoxels, optional

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


def _of_view(observation: Observation, view: int, active: ActiveVoxels | None) -> Misplaced | None:
    """Return what the image of one view is, if not its own."""
    seen = _predicted(observation, view, _without(observation, (view,), active))
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
    volume = _without(observation, (view, other), active)
    seen, mask = _predicted(observation, other, volume), observation.masks[other]
    own, foreign = observation.images[other], observation.images[view]
    return _error(foreign, seen, mask & observation.masks[view]) < _error(own, seen, mask)


def _without(
    observation: Observation, views: tuple[int, ...], active: ActiveVoxels | None
) -> NDArray[np.float32]:
    """Return a quick volume from all views but some."""
    masks = tuple(
        np.zeros_like(mask) if view in views else mask
        for view, mask in enumerate(observation.masks)
    )
    return first_fit(replace(observation, masks=masks), active).means


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
