"""Watching a series: what changes in it for good, found in the figures of its frames.

A plan is settled once. A camera whose gain drifts, a view that stops being explained and a
held-out camera that is predicted worse show in the table of figures, not in a single frame.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from tomo.series.store import LEFT_OUT

SHORTEST = 8
"""Frames that a change has to last, and that have to come before it. Fewer: gusts are taken for
changes. More: changes near the ends of a film are overlooked."""

APART = 2.5
"""Ratio of a lasting change to the spread of the frames around it (1.48 times their median
deviation). A steady drift has 2.7. Lower: slow turbulence is taken for a drift."""

CUTS = 64
"""Places between which a change is looked for, at the most: more take time, and find its first
frame no better, which is looked for by itself."""

DRIFT = 0.03
"""Change of a camera's light against the others', as a fraction. It is some 0.8 of the change of
the gain, as the volume follows. Lower: a plume that grows, one of whose views drifts by 2.5 %."""

WORSE = 1.5
"""Ratio of residuals after and before. Lower: flames of which more and more is fine structure."""

FALL = 3.0
"""Fall of a held-out PSNR in dB. Lower: a plume that becomes brighter, at 1.4 dB in 40 frames."""

SPIKE = 2.0
"""Ratio of a frame's residual to the median of its neighbours, at the least."""

RARE = 6.0
"""The logarithm of that ratio over the spread of all frames'. Lower: flames that flicker."""

NEIGHBOURS = 15
"""Frames on either side with which a frame is compared."""


Words = Callable[[str, float, int], str]
"""Says a change: of a camera, its size, and the first frame."""


@dataclass(frozen=True)
class Finding:
    """Something of a series that changes."""

    kind: str  # gain, residual, psnr, spikes or skipped
    camera: str  # empty where it is no single camera's
    frame: int  # number in the scan of the first frame concerned
    size: float  # a fraction of the gain, a ratio of residuals, dB, or how many frames
    line: str


def watch(
    table: Mapping[str, NDArray], frames: ArrayLike, cameras: Sequence[str]
) -> list[Finding]:
    """Return what changes in a series for good, and frames that stand out.

    ``table`` has ``view_light``, ``view_residual`` and ``psnr`` ``(frames, cameras)``, NaN where
    there is none, and ``complete`` ``(frames,)``. Frames left out come first, then kinds and
    cameras.
    """
    numbers = np.asarray(frames)
    found = list(_left_out(np.asarray(table["complete"]), numbers))
    for kind, (figure, transform, least, words) in _CHANGES.items():
        for camera, values in zip(cameras, transform(np.asarray(table[figure])).T, strict=True):
            known = np.isfinite(values)
            change = lasting_change(values[known])
            if change is None:
                continue
            place, size = change
            size = math.expm1(size) if kind == "gain" else size
            if (size if kind == "residual" else -size if kind == "psnr" else abs(size)) >= least:
                number = int(numbers[known][place])
                found.append(Finding(kind, camera, number, size, words(camera, size, number)))
    found += _spikes(np.asarray(table["view_residual"]), numbers, cameras)
    return found


def lasting_change(values: NDArray[np.float64]) -> tuple[int, float] | None:
    """Return the place from which values ``(N,)`` differ for good, and by how much; None: nowhere.

    Medians before and after are compared, at the place where they fit best, and the change counts
    where it is `APART` times the spread around them. Where a straight line fits better, the change
    is that of the line from its first to its last value. The place is that from which values lie
    nearer the new level than the old one.

    >>> lasting_change(np.repeat([1.0, 1.5], 20))
    (20, 0.5)
    """
    count = len(values)
    if count < 2 * SHORTEST:
        return None
    cuts = np.unique(np.linspace(SHORTEST, count - SHORTEST, CUTS).astype(int))
    levels = np.array([(np.median(values[:cut]), np.median(values[cut:])) for cut in cuts])
    errors = [
        np.abs(values[:cut] - before).sum() + np.abs(values[cut:] - after).sum()
        for cut, (before, after) in zip(cuts, levels, strict=True)
    ]
    best = int(np.argmin(errors))
    cut, (before, after) = int(cuts[best]), levels[best]
    around = np.concatenate([values[:cut] - before, values[cut:] - after])
    spread = 1.4826 * float(np.median(np.abs(around)))
    if not abs(after - before) > APART * spread or after == before:
        return None
    line = np.poly1d(np.polyfit(np.arange(count), values, 1))
    if np.abs(values - line(np.arange(count))).sum() < min(errors):
        before, after = line(0), line(count - 1)
    changed = (values - (before + after) / 2) * np.sign(after - before) > 0
    if not changed[-SHORTEST:].mean() > 0.5:
        return None  # it went back
    # the place that parts the unchanged from the changed with the fewest on the wrong side
    wrong = np.concatenate([[0], np.cumsum(changed)]) + np.concatenate(
        [np.cumsum(~changed[::-1])[::-1], [0]]
    )
    return int(np.argmin(wrong)), float(after - before)


def in_words(findings: Sequence[Finding]) -> list[str]:
    """Return the findings in lines, a handful at most: one for three cameras and more."""
    lines = []
    for kind in dict.fromkeys(one.kind for one in findings):
        own = [one for one in findings if one.kind == kind]
        if len(own) <= 2:
            lines += [one.line for one in own]
            continue
        first, *rest = sorted(own, key=lambda one: -abs(one.size))
        others = ", ".join(
            one.camera if one.frame == first.frame else f"{one.camera} (frame {one.frame})"
            for one in rest
        )
        lines.append(f"{first.line}; less so {others}")
    return lines


def _left_out(complete: NDArray, numbers: NDArray) -> Iterator[Finding]:
    """Yield the finding on frames that could not be read."""
    bad = numbers[complete == LEFT_OUT]
    if len(bad):
        line = f"{_count(len(bad))} could not be read and left out: {_listed(bad)}"
        yield Finding("skipped", "", int(bad[0]), float(len(bad)), line)


def _spikes(residuals: NDArray, numbers: NDArray, cameras: Sequence[str]) -> Iterator[Finding]:
    """Yield the frames whose residual stands out from that of their neighbours, by camera."""
    from scipy.ndimage import median_filter

    for camera, values in zip(cameras, residuals.T, strict=True):
        known = np.isfinite(values) & (values > 0)
        own = values[known]
        if len(own) < 2 * SHORTEST:
            continue
        ratios = own / median_filter(own, 2 * NEIGHBOURS + 1)
        usual = RARE * 1.4826 * float(np.median(np.abs(np.log(ratios))))
        at = np.flatnonzero(ratios > max(SPIKE, math.exp(usual)))
        if not len(at):
            continue
        where = numbers[known][at]
        line = (
            f"{camera}: residual jumps in {_count(len(at))}, up to {ratios[at].max():.1f} times "
            f"that of their neighbours: {_listed(where)}"
        )
        yield Finding("spikes", camera, int(where[0]), float(len(at)), line)


def _logarithm(values: NDArray) -> NDArray:
    """Return logarithms; NaN where there is none."""
    return np.log(np.where(values > 0, values, np.nan))


def _against_the_others(values: NDArray) -> NDArray:
    """Return logarithms ``(frames, cameras)`` less what the cameras have in common in each frame.

    A volume follows a camera that drifts, and is wrong for the others. Each camera's median over
    the frames is taken away first.
    """
    logarithms = np.ma.masked_invalid(_logarithm(values))
    for axis in (0, 1):
        logarithms = logarithms - np.ma.median(logarithms, axis=axis, keepdims=True)
    return logarithms.filled(np.nan)


def _count(count: int) -> str:
    return "1 frame" if count == 1 else f"{count} frames"


def _listed(numbers: NDArray, most: int = 6) -> str:
    more = f" and {len(numbers) - most} more" if len(numbers) > most else ""
    return ", ".join(str(one) for one in numbers[:most]) + more


_CHANGES: dict[str, tuple[str, Callable[[NDArray], NDArray], float, Words]] = {
    "gain": (
        "view_light",
        _against_the_others,
        DRIFT,
        lambda camera, size, frame: (
            f"{camera}: gain drifts {size:+.0%} from frame {frame}: its exposure, aperture or "
            "window changed; reconstruct the frames before and after by themselves"
        ),
    ),
    "residual": (
        "view_residual",
        _logarithm,
        math.log(WORSE),
        lambda camera, size, frame: (
            f"{camera}: residual jumps to {math.exp(size):.1f} times from frame {frame}: the "
            "camera moved, or its frames come at another time"
        ),
    ),
    "psnr": (
        "psnr",
        np.asarray,
        FALL,
        lambda camera, size, frame: (
            f"{camera}: held-out PSNR falls by {-size:.1f} dB from frame {frame}"
        ),
    ),
}
"""For each change: the figure, what makes changes of it differences, the least, and the words."""
