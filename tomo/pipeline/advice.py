"""Lines of a scan.yaml that correct what the images showed."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from tomo.operators.view_gains import NOTEWORTHY, SIGNIFICANT, Gains
from tomo.scan import Corrections
from tomo.scan.corrections import correction_line

ALIKE = 0.1
"""Relative spread of the cameras' levels up to which one number stands for all of them."""

MOST_LISTED = 8
"""Cameras of a line; the largest corrections come first, and report.json has all."""


def lines_for_gains(
    gains: Gains, names: Sequence[str], corrections: Corrections
) -> tuple[str, ...]:
    """Return the lines that correct fitted gains and backgrounds in a scan's own numbers.

    Parameters
    ----------
    gains : Gains
        A camera's gain is the factor by which it records too much.
    names : sequence of str
        The cameras, in the order of the gains.
    corrections : Corrections
        Those of the scan, which are already in the images. A camera whose dark is an image gets
        no line for its background, one with a flat field neither.

    Returns
    -------
    lines : tuple of str
        None, one or two: for backgrounds and for gains, where they are far above their errors.
    """
    lines = []
    dark = {}
    for view in _far(gains.offset, gains.offset_error, NOTEWORTHY * gains.scale):
        known, name = corrections.of("dark", names[view]) or 0.0, names[view]
        if isinstance(known, int | float) and corrections.of("flat", name) is None:
            factor = corrections.of("gain", name) or 1.0
            dark[name] = known + gains.offset[view] / factor
    if dark:
        values = np.array(list(dark.values()))
        alike = len(dark) == len(names) > 1 and np.ptp(values) <= ALIKE * abs(values.mean())
        lines.append(correction_line("dark", float(values.mean()) if alike else _few(dark)))
    logs = np.log(gains.gain)
    factors = {
        names[view]: (corrections.of("gain", names[view]) or 1.0) / gains.gain[view]
        for view in _far(logs, gains.gain_error / gains.gain, NOTEWORTHY)
    }
    if factors:
        lines.append(correction_line("gain", _few(factors)))
    return tuple(lines)


def _far(
    values: NDArray[np.float64], errors: NDArray[np.float64], least: float
) -> NDArray[np.intp]:
    """Return the views whose value is real and large, the largest first."""
    size = np.abs(values)
    real = np.isfinite(errors) & (size > SIGNIFICANT * errors) & (size > least)
    order = np.argsort(-size, kind="stable")
    return order[real[order]]


def _few(values: dict[str, float]) -> dict[str, float]:
    return dict(list(values.items())[:MOST_LISTED])
