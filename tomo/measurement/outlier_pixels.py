"""Outliers of one or two adjacent pixels: sharper than any lens can image."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from tomo.measurement.noise_model import NoiseModel, estimate_noise

TIMES = 3.0
"""Threshold on a pixel's deviation from its neighbours, in units of the local deviation."""

TYPICAL = 6
"""Rank of the order statistic, among the 24 neighbours, used as the local deviation."""

ALONG = 0.4
"""Fraction of its deviation by which it must also miss the nearest of the four predictions."""

SIGMAS = 3.0  # standard deviations of the noise, times TIMES
FRACTION = 0.015  # fraction of the image's brightest light, times TIMES
PASSES = 6
"""Passes at most. An outlier makes its neighbours deviate, so each pass takes the largest of
adjacent candidates and the next one tests the others without it."""

AROUND = [(y, x) for y in range(-2, 3) for x in range(-2, 3) if (y, x) != (0, 0)]
RING = [(y, x) for y, x in AROUND if max(abs(y), abs(x)) == 2]
TOUCHING = [step for step in AROUND if step not in RING]
SIDES = ((0, 1), (0, -1), (1, 0), (-1, 0))
PAIRS = ((0, 1), (1, 0), (1, 1), (1, -1))
OPPOSITE = [(-y, -x) for y, x in PAIRS]


def find_outlier_pixels(
    image: ArrayLike, mask: ArrayLike | None = None, noise: NoiseModel | None = None
) -> NDArray[np.bool_]:
    """Return the usable pixels that are outliers, ``(height, width)`` bool.

    Pixels that are not usable by ``mask`` are ignored; the noise is estimated when None. Each of
    the four lines through a pixel predicts it by the mean of its two neighbours on that line. The
    prediction is the mean of the second and third largest: one outlying neighbour does not move
    it. On a smooth image the deviation is the curvature, which neighbours have as well. A pixel is
    an outlier when its deviation exceeds three times the sum of the sixth largest deviation of the
    24 around it, three standard deviations of the noise, one photon and 1.5 % of the image's
    brightest light, and when it lies beyond all four predictions: along a crease, as at the edge
    of a box, one of them holds. A lens spreads real light: where three of the four adjacent pixels
    are raised as well, by a third of its deviation, the spot is real.
    """
    image = np.asarray(image, np.float32)
    usable = np.isfinite(image)
    if mask is not None:
        usable &= np.asarray(mask, bool)
    outliers = np.zeros(image.shape, bool)
    if min(image.shape) < 5 or not image.any(where=usable):
        return outliers
    scale: Any = np.float32(np.abs(image).max(where=usable, initial=0.0))
    noise = estimate_noise(image, usable) if noise is None else noise
    noise = NoiseModel(noise.read / scale, noise.gain / scale)
    image = np.where(usable, image / scale, 0)
    known = usable
    for _ in range(PASSES):
        filled = np.where(known, image, _mean_around(image, known))
        expected = _middle_of_pairs(filled)
        deviation = np.where(usable, image, expected) - expected
        light = float(expected.max(initial=0.0, where=known))
        sigma = np.sqrt(noise.variance(expected)).astype(np.float32)
        far = FRACTION * light + SIGMAS * sigma + np.float32(noise.gain)
        # Known outliers are filled in, so that they do not enlarge the local deviation.
        spread = np.abs(filled - expected)
        found = _confirmed(deviation, filled, spread, far, usable & ~outliers)
        if not found.any():
            break
        outliers |= found
        known = known & ~found
    return outliers


def _confirmed(
    deviation: NDArray[np.float32],
    filled: NDArray[np.float32],
    spread: NDArray[np.float32],
    far: NDArray[np.float32],
    asked: NDArray[np.bool_],
) -> NDArray[np.bool_]:
    """Return which of the candidates ``asked`` are outliers, testing only the few that may be."""
    found = np.zeros(asked.shape, bool)
    rows, columns = np.nonzero(asked & (np.abs(deviation) > TIMES * far))
    if not len(rows):
        return found
    filled = np.pad(filled, 2, mode="reflect")
    own = deviation[rows, columns]  # (candidates,)
    sign = np.sign(own)
    ends = (_neighbours(filled, rows, columns, side) for side in (PAIRS, OPPOSITE))
    lines = sign * sum(ends) / 2  # (4, candidates)
    beyond = sign * filled[rows + 2, columns + 2] - lines.max(axis=0)
    likely = beyond > ALONG * np.abs(own)
    rows, columns, own, sign = rows[likely], columns[likely], own[likely], sign[likely]
    if not len(rows):
        return found
    spread = np.pad(spread, 2, mode="reflect")
    typical = np.partition(_neighbours(spread, rows, columns, AROUND), -TYPICAL, axis=0)[-TYPICAL]
    near = sign * _neighbours(filled, rows, columns, SIDES)
    ground = sign * _neighbours(filled, rows, columns, RING)
    lifted = np.sort(near, axis=0)[1] - np.median(ground, axis=0)
    level = np.maximum(typical + far[rows, columns], lifted)
    outliers = np.abs(own) > TIMES * level
    rows, columns, own = rows[outliers], columns[outliers], own[outliers]
    if not len(rows):
        return found
    found[rows, columns] = True
    deviating = np.pad(np.where(found, np.abs(deviation), 0), 2, mode="reflect")
    larger = _neighbours(deviating, rows, columns, TOUCHING)
    found[rows, columns] = np.abs(own) >= larger.max(axis=0)
    return found


def _neighbours(
    padded: NDArray[np.float32],
    rows: NDArray[np.intp],
    columns: NDArray[np.intp],
    steps: Sequence[tuple[int, int]],
) -> NDArray[np.float32]:
    """Return the values at ``steps`` (rows, columns) from each candidate: ``(steps, candidates)``.

    ``padded`` has two more pixels on every side.
    """
    return np.stack([padded[rows + 2 + y, columns + 2 + x] for y, x in steps])


def _middle_of_pairs(image: NDArray[np.float32]) -> NDArray[np.floating]:
    """Return the mean of the second and third of the four lines' predictions."""
    height, width = image.shape
    # Odd reflection goes on straight beyond the border: a slope is no deviation.
    padded = np.pad(image, 1, mode="reflect", reflect_type="odd")

    def at(y: int, x: int) -> NDArray[np.float32]:
        return padded[1 + y : 1 + y + height, 1 + x : 1 + x + width]

    total = np.zeros(image.shape, np.float32)
    lowest = np.full(image.shape, np.inf, np.float32)
    highest = np.full(image.shape, -np.inf, np.float32)
    for y, x in PAIRS:
        pair = (at(y, x) + at(-y, -x)) / 2
        total += pair
        np.minimum(lowest, pair, out=lowest)
        np.maximum(highest, pair, out=highest)
    return (total - lowest - highest) / 2


def _mean_around(image: NDArray[np.float32], known: NDArray[np.bool_]) -> NDArray[np.float32]:
    """Return the mean of the known pixels of each 3 x 3; zero where there is none."""
    if known.all():
        return image
    import cv2

    size = (3, 3)
    total = cv2.blur(np.where(known, image, 0), size, borderType=cv2.BORDER_REFLECT_101)
    share = cv2.blur(known.astype(np.float32), size, borderType=cv2.BORDER_REFLECT_101)
    return np.divide(total, share, out=np.zeros_like(total), where=share > 1e-6)
