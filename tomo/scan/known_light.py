"""An image of a lamp or an integrating sphere: its mean counts, if it is fit to calibrate by."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from tomo.scan.corrections import Corrections
from tomo.scan.image_source import holds_integers

UNEVEN = 0.05
"""Largest relative difference of a block from the mean of the region of a known radiance. Lower,
a good sphere and a good lens are refused; higher, vignetting changes the mean by per cents."""

BLOCKS = 4
"""Blocks along a side of the region: fewer do not see a slope; more are noise."""


def counts_of_known_light(
    image: Path | NDArray,
    camera: str,
    size: tuple[int, int],
    corrections: Corrections,
    region: Sequence[int] | None = None,
    dark: float | Path | NDArray | None = None,
) -> float:
    """Return the mean counts of a lamp or an integrating sphere over its region.

    All of the scan's corrections but the gain apply. ``region`` is ``(x, y, width, height)``, the
    whole image when None; ``dark`` takes the place of that of the corrections.
    """
    how = replace(corrections, gain=None)
    if dark is not None:
        _check_dark(camera, dark, image)
        how = replace(how, dark={camera: dark})
    place = f"camera {camera}: "
    try:
        counts, usable, *_ = how.corrected(image, camera, size, per_count=1.0)
        mask = how.pixels("mask", camera, size)
    except ValueError as error:  # a FrameError would be one frame's, and could be skipped
        raise ValueError(f"calibration.image: {error}") from error
    if not isinstance(image, np.ndarray):
        place = f"{image}: {place}"
    part = _part(region, size, counts.shape, place)
    counts, usable = counts[part], usable[part]
    allowed = np.ones(counts.shape, bool) if mask is None else np.asarray(mask)[part] != 0
    lost = np.count_nonzero(allowed & ~usable)
    if lost:
        raise ValueError(
            f"calibration.image: {place}found {lost} of {allowed.sum()} pixels of its region "
            "saturated, or dead in the flat, expected none: expose for a shorter time, or "
            "give a smaller region"
        )
    return _even_mean(counts, usable, f"calibration.image: {place}")


def _part(
    region: Sequence[int] | None, size: tuple[int, int], shape: tuple[int, ...], place: str
) -> tuple[slice, slice]:
    """Return rows and columns of a region; ``shape`` is that of a mosaic's colour, or the size."""
    if region is None:
        return slice(None), slice(None)
    x, y, width, height = region
    step = 1 if shape == tuple(size[::-1]) else 2
    rows = slice(-(-y // step), (y + height) // step)
    columns = slice(-(-x // step), (x + width) // step)
    is_inside = x >= 0 and y >= 0 and x + width <= size[0] and y + height <= size[1]
    if not is_inside or rows.stop <= rows.start or columns.stop <= columns.start:
        raise ValueError(
            f"calibration.region: {place}found {list(region)}, expected [x, y, width, height] "
            f"inside the image of {size[0]} x {size[1]} pixels"
        )
    return rows, columns


def _even_mean(counts: NDArray[np.float32], usable: NDArray[np.bool_], where: str) -> float:
    """Return the mean of usable pixels; refuse a region that is dark or not even."""
    mean = float(counts[usable].mean(dtype=np.float64)) if usable.any() else 0.0
    if not mean > 0:
        raise ValueError(f"{where}found {mean:.3g} counts on average, expected light: check dark")
    worst = 0.0
    for rows in np.array_split(np.arange(counts.shape[0]), BLOCKS):
        for columns in np.array_split(np.arange(counts.shape[1]), BLOCKS):
            block = np.ix_(rows, columns)
            if usable[block].any():
                own = float(counts[block][usable[block]].mean(dtype=np.float64))
                worst = max(worst, abs(own / mean - 1))
    if worst > UNEVEN:
        raise ValueError(
            f"{where}found parts of its region that differ by {worst:.1%} from its mean, expected "
            f"at most {UNEVEN:.0%}: give a smaller region, or correct vignetting by a flat"
        )
    return mean


def _check_dark(camera: str, dark: float | Path | NDArray, image: Path | NDArray) -> None:
    """Refuse a number of counts: numbers are in the scale of `Corrections`."""
    if isinstance(dark, int | float) and dark > 1 and holds_integers(image):
        raise ValueError(
            f"calibration.dark: camera {camera}: found {dark:g}, expected at most 1, the full "
            "scale of integers, or an image"
        )
