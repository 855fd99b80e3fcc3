"""What single cameras' gains and backgrounds come to as corrections of their scan."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from tomo.inference.finding import Finding
from tomo.measurement.pixel_check import PixelCheck
from tomo.operators.view_gains import NOTEWORTHY, Gains
from tomo.scan import Scan
from tomo.scan.advice import correction_line

ALIKE = 0.1
"""Relative spread of the cameras' levels up to which one number stands for all of them."""


def with_lines(
    findings: Sequence[Finding],
    pixels: PixelCheck | None,
    gains: Gains | None,
    names: Sequence[str],
    scan: Scan,
) -> tuple[Finding, ...]:
    """Return findings on gains and backgrounds with what corrects them, in the way of the scan.

    Parameters
    ----------
    findings : sequence of Finding
    pixels : PixelCheck, optional
    gains : Gains, optional
        Those that the images of ``names``, in this order, were corrected by.
    names : sequence of str
    scan : Scan
        The whole one. Its corrections are in the images already: lines are in its own numbers.
    """
    own: dict[str, list[str]] = {"background": [], "gain": []}
    for one in findings:
        if one.effect in own and one.camera and abs(one.size) > NOTEWORTHY:
            own[one.effect].append(one.camera)
    levels, factors = dict(pixels.background) if pixels else {}, {}
    if gains is not None:
        levels |= dict(zip(names, gains.offset.tolist(), strict=True))
        factors = dict(zip(names, (1 / gains.gain).tolist(), strict=True))
    lines = {
        "background": _line_for_dark({n: levels[n] for n in own["background"]}, scan),
        "gain": _line_for_gain({n: factors[n] for n in own["gain"]}, scan),
    }
    return tuple(replace(one, line=lines.get(one.effect), way=scan.way) for one in findings)


def _line_for_dark(levels: Mapping[str, float], scan: Scan) -> str | None:
    """Return the line that subtracts levels; None where darks are images, or units are others."""
    names, corrections = scan.rig.names, scan.corrections
    given = {name: corrections.of("dark", name) for name in names}
    known = {name: 0.0 if dark is None else dark for name, dark in given.items()}
    numbers = all(isinstance(one, int | float) for one in known.values())
    flat = any(corrections.of("flat", name) is not None for name in levels)
    if not levels or not numbers or flat or scan.radiometry is not None:
        return None
    dark = {name: float(level) for name, level in known.items() if level}
    for name in sorted(levels, key=lambda name: -levels[name]):
        factor = corrections.of("gain", name) or 1.0
        dark[name] = dark.get(name, 0.0) + levels[name] / factor
    values = np.array(list(dark.values()))
    alike = len(dark) == len(names) > 1 and np.ptp(values) <= ALIKE * abs(values.mean())
    return correction_line(scan.way, "dark", float(values.mean()) if alike else dark)


def _line_for_gain(factors: Mapping[str, float], scan: Scan) -> str | None:
    """Return the line that multiplies images by further factors."""
    given = {name: scan.corrections.of("gain", name) or 1.0 for name in factors}
    found = {name: given[name] * factor for name, factor in factors.items()}
    return correction_line(scan.way, "gain", found) if found else None
