"""The power spectral density of every voxel over time, by Welch's method, in slabs of voxels.

Mean and RMS of the fluctuation come from one pass over the frames.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import zarr
from numpy.typing import NDArray

from rigs.files import atomic_path
from tomo.export.export import Frames
from tomo.grid import mean_and_rms
from tomo.io.volume_film import create_array


def write_statistics(frames: Frames, target: Path) -> None:
    """Write ``mean`` and ``rms`` of the frames into a Zarr group that xarray reads."""
    if len(frames) < 2:
        raise ValueError(
            f"{frames.store.path}: frames: found 1, expected 2 or more for statistics"
        )
    with result_store(frames, target) as group:
        mean, rms = mean_and_rms(frames.volumes())
        unit = frames.store.attributes["value_unit"]
        for name, values, words in (
            ("mean", mean, "mean over time"),
            ("rms", rms, "root mean square of the fluctuation about the mean"),
        ):
            create_array(
                group, name, values.shape, frames.chunk(), "f4", ("x", "y", "z"),
                units=unit, long_name=f"{words} of a voxel's emission",
            )[:] = values.astype(np.float32)  # fmt: skip


@contextmanager
def result_store(frames: Frames, target: Path, **attributes: Any) -> Iterator[zarr.Group]:
    """Yield a new Zarr group with coordinates, which appears at ``target`` whole or not at all."""
    if target.exists():
        raise FileExistsError(f"{target}: is there already, expected the name of a new store")
    with atomic_path(target) as temporary:
        group = zarr.create_group(
            temporary,
            zarr_format=3,
            attributes={
                **frames.about(),
                "store": frames.store.path.name,
                "frames": frames.numbers.tolist(),
                "grid": frames.store.grid.to_mapping(),
                "length_unit": frames.store.attributes["length_unit"],
                **attributes,
            },
        )
        for name in "xyz":
            centres, unit = frames.axis(name)
            shape = centres.shape
            create_array(group, name, shape, shape, "f8", (name,), units=unit)[:] = centres
        yield group


SEGMENT = 256
"""Frames of a segment, at the most: scipy's own. More resolve frequencies better and scatter
more, and take more memory."""

BUFFER = 64 << 20
"""Bytes of the frames of a segment; their transform takes five times as much. Less: the frames are
read more often."""

UNEVEN = 1e-3
"""Largest deviation of a time step from the mean one, as a fraction of it."""


def write_spectrum(frames: Frames, target: Path) -> None:
    """Write ``power`` ``(frequency, x, y, z)`` into a Zarr group that xarray reads.

    Segments of a power of two of frames, at most `SEGMENT`, overlap by half; each loses its mean
    and is windowed by Hann's window; their one-sided periodograms are averaged, as
    `scipy.signal.welch` does. The sum over frequencies times their spacing is the variance, but
    for the window.

    P. D. Welch, "The use of fast Fourier transform for the estimation of power spectra", IEEE
    Trans. Audio Electroacoust. 15 (1967), 70-73.
    """
    rate, length = rate_of(frames), segment_of(len(frames))
    unit, per = frames.store.attributes["value_unit"], frames.store.attributes["time_unit"]
    hertz = "Hz" if per == "s" else "1/frame"
    grid = frames.store.grid
    frequencies = np.fft.rfftfreq(length, 1 / rate)
    settings = {"segment_frames": length, "overlap_frames": length // 2, "window": "hann"}
    with result_store(frames, target, **settings) as group:
        shape = frequencies.shape
        axis = create_array(group, "frequency", shape, shape, "f8", ("frequency",), units=hertz)
        axis[:] = frequencies
        slab = _slab(grid.shape, length)
        power = create_array(
            group,
            "power",
            (len(frequencies), *grid.shape),
            (len(frequencies), slab, *grid.shape[1:]),
            "f4",
            ("frequency", "x", "y", "z"),
            units=f"({unit})^2 / {hertz}" if hertz == "Hz" else f"({unit})^2 frame",
            long_name="one-sided power spectral density of a voxel's emission",
        )
        for start in range(0, grid.shape[0], slab):
            part = slice(start, min(start + slab, grid.shape[0]))
            power[:, part] = welch(frames, part, rate, length)


def welch(frames: Frames, part: slice, rate: float, length: int) -> NDArray[np.float32]:
    """Return the spectra of the voxels of some planes of x, ``(frequencies, planes, ny, nz)``."""
    from scipy.signal import periodogram

    waiting: list[NDArray] = []
    total, count = np.zeros(()), 0
    for volume in frames.volumes(f"planes {part.start} to {part.stop - 1} of x, "):
        waiting.append(volume[part].copy())
        if len(waiting) == length:
            _, power = periodogram(
                np.array(waiting), rate, window="hann", detrend="constant", axis=0
            )
            total, count = total + power.astype(np.float64), count + 1
            del waiting[: length - length // 2]
    return (total / count).astype(np.float32)


def rate_of(frames: Frames) -> float:
    """Return the frames in a unit of time, which has to be the same all the time."""
    if len(frames) < 4:
        raise ValueError(
            f"{frames.store.path}: frames: found {len(frames)}, expected 4 or more for a spectrum"
        )
    return 1 / float(np.median(check_even(frames, "a spectrum")))


def check_even(frames: Frames, format: str) -> NDArray[np.float64]:
    """Return the times from one frame to the next, which have to be the same all the time."""
    steps = np.diff(frames.times)
    step = float(np.median(steps))
    off = np.flatnonzero(np.abs(steps - step) > UNEVEN * step)
    if len(off):
        raise ValueError(
            f"{frames.store.path}: time: found frames {frames.numbers[off[0]]} and "
            f"{frames.numbers[off[0] + 1]} {steps[off[0]]:.4g} apart, others {step:.4g}, expected "
            f"even times for {format}: choose frames without gaps"
        )
    return steps


def segment_of(count: int) -> int:
    """Return the frames of a segment: a power of two, with three segments where that is possible.

    >>> segment_of(40), segment_of(5000)
    (16, 256)
    """
    return min(SEGMENT, max(1 << int(np.log2(count / 2)), 4))


def _slab(shape: tuple[int, int, int], length: int) -> int:
    """Return how many planes of x are done at once."""
    return int(min(max(BUFFER // (4 * length * shape[1] * shape[2]), 1), shape[0]))
