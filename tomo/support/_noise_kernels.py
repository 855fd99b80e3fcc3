"""The compiled steps of `tomo.support.noise_model`: they let go of Python, view beside view."""

from __future__ import annotations

import math

import numpy as np

from tomo._compile import compiled

PIXELS_A_LEVEL = 400  # enough for a spread to 8 per cent
MOST_LEVELS = 20
QUARTER_OF_A_NORMAL = 0.318639  # a quarter of |N(0, 1)| lies below
ROUNDS = 4  # of reweighting the straight line

_GOLDEN_SECTION = (5**0.5 - 1) / 2
_DIGIT, _DIGITS = 11, 3  # bits of a digit, and how many of them 32 bits have


@compiled()
def read_and_gain(image, mask, signal, takes_away):
    """Return the read-out noise and gain of an image; see `estimate_noise`.

    Parameters
    ----------
    image, signal : (height, width) float
        What was seen, and what tells its level; of one type.
    mask : (height, width) or (0, 0) bool
        True where a pixel is usable; every one where empty.
    takes_away : bool
        Whether the filter sees the image less the signal.
    """
    level, fine = _nines(image, mask, signal, takes_away)
    most = PIXELS_A_LEVEL * MOST_LEVELS
    if len(level) > most:  # spread by the golden section: no step falls in with the rows
        share, count = most / len(level), 0
        for n in range(len(level)):
            place = n * _GOLDEN_SECTION
            if place - math.floor(place) < share:
                level[count], fine[count] = level[n], fine[n]
                count += 1
        level, fine = level[:count], fine[:count]
    if len(level) == 0:
        return 0.0, 0.0
    parts = min(max(len(level) // PIXELS_A_LEVEL, 1), MOST_LEVELS)
    size, at = len(level) // parts, len(level) % parts
    order = _ascending(level)
    means, variances, some = np.zeros(parts), np.zeros(parts), np.zeros(size)
    for part in range(parts):
        for n in range(size):
            means[part] += level[order[at]] / size
            some[n] = fine[order[at]]
            at += 1
        variances[part] = (_smallest(some, size // 4) / QUARTER_OF_A_NORMAL) ** 2
    return _line(means, variances)


@compiled(inline=True)
def _nines(image, mask, signal, takes_away):
    """Return the mean of ``signal`` and the filter's magnitude of all 3 x 3 pixels that count.

    Those whose pixels are usable and of which at most one is zero.
    """
    height, width = image.shape
    most = (height - 2) * (width - 2)
    level, fine, count = np.zeros(most), np.zeros(most), 0
    # of three pixels above each other: 1 a zero, 2 one that is not usable; their sum; the filter
    against, total, down = np.zeros(width, np.int64), np.zeros(width), np.zeros(width)
    share = 1.0 if takes_away else 0.0
    for row in range(height - 2):
        for column in range(width):
            high, even, low = image[row, column], image[row + 1, column], image[row + 2, column]
            zeros = (high == 0) + (even == 0) + (low == 0)
            strange = (high - high != 0) + (even - even != 0) + (low - low != 0)  # not finite
            against[column] = zeros + 2 * strange
            top, middle, bottom = (
                np.float64(signal[row, column]),
                np.float64(signal[row + 1, column]),
                np.float64(signal[row + 2, column]),
            )
            total[column] = top + middle + bottom
            outer = (high - share * top) + (low - share * bottom)
            down[column] = outer - 2 * (even - share * middle)
        if mask.size > 0:
            for column in range(width):
                for below in range(3):
                    against[column] += 2 * (not mask[row + below, column])
        for column in range(width - 2):
            level[count] = (total[column] + total[column + 1] + total[column + 2]) / 9
            fine[count] = abs(down[column] - 2 * down[column + 1] + down[column + 2]) / 6
            count += against[column] + against[column + 1] + against[column + 2] < 2
    return level[:count], fine[:count]


@compiled(inline=True)
def _ascending(values):
    """Return the numbers of values (n,) from the smallest to the largest, in single precision.

    Digit by digit of their bits, the last first: an order without comparisons, whose branches
    would be guessed wrongly every other time.
    """
    count, largest = len(values), 0.0
    for n in range(count):
        largest = max(largest, abs(values[n]))
    single = np.zeros(count, np.float32)
    for n in range(count):
        single[n] = values[n] / largest if largest > 0 else 0.0
    bits, order = single.view(np.int32), np.arange(count)
    other_bits, other_order = np.zeros(count, np.int32), np.zeros(count, np.int64)
    for n in range(count):  # as whole numbers, floats are in order, those below zero reversed
        bits[n] ^= (bits[n] >> 31) | np.int32(-(1 << 31))
    for digit in range(_DIGITS):
        shift, ends, begun = digit * _DIGIT, np.zeros(1 << _DIGIT, np.int64), 0
        for n in range(count):
            ends[np.uint64((bits[n] >> shift) & ((1 << _DIGIT) - 1))] += 1
        for d in range(1 << _DIGIT):
            begun += ends[d]
            ends[d] = begun - ends[d]
        for n in range(count):
            d = np.uint64((bits[n] >> shift) & ((1 << _DIGIT) - 1))
            at = np.uint64(ends[d])
            ends[d] += 1
            other_bits[at], other_order[at] = bits[n], order[n]
        bits, other_bits = other_bits, bits
        order, other_order = other_order, order
    return order


@compiled(inline=True)
def _smallest(values, rank):
    """Return the value that so many of ``values`` (n,) are smaller than; they are reordered.

    Hoare, "Algorithm 65: find", Communications of the ACM 4 (1961).
    """
    low, high = 0, len(values) - 1
    while low < high:
        middle, i, j = values[(low + high) // 2], low, high
        while i <= j:
            while values[i] < middle:
                i += 1
            while values[j] > middle:
                j -= 1
            if i <= j:
                values[i], values[j] = values[j], values[i]
                i += 1
                j -= 1
        if rank <= j:
            high = j
        elif rank >= i:
            low = i
        else:
            break
    return values[rank]


@compiled(inline=True)
def _line(level, variance):
    """Return the read-out noise and gain nearest to variances (n,) at levels (n,).

    Errors are in proportion to the variance, as the line itself gives it.
    """
    count = len(level)
    mean = intercept = slope = 0.0
    for n in range(count):
        mean += variance[n] / count
    expected = np.full(count, mean)
    for _ in range(ROUNDS):
        largest = 0.0
        for n in range(count):
            largest = max(largest, expected[n])
        if largest == 0:
            return 0.0, 0.0
        total = x = y = along = across = 0.0
        for n in range(count):
            weight = 1 / max(expected[n], 1e-6 * largest) ** 2
            total += weight
            x += weight * max(level[n], 0.0)
            y += weight * variance[n]
        x, y = x / total, y / total
        spread = leaning = 0.0
        for n in range(count):
            weight, at = 1 / max(expected[n], 1e-6 * largest) ** 2, max(level[n], 0.0)
            spread += weight * (at - x) ** 2
            leaning += weight * (at - x) * (variance[n] - y)
            across += weight * at * variance[n]
            along += weight * at**2
        slope = max(leaning / spread, 0.0) if spread > 0 else 0.0
        intercept = y - slope * x
        if intercept < 0:
            intercept, slope = 0.0, across / along
        for n in range(count):
            expected[n] = intercept + slope * max(level[n], 0.0)
    return math.sqrt(intercept), slope
