"""Lines of a scan.yaml that correct what the images showed."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from tomo.measurement.pixel_check import PixelCheck
from tomo.operators.view_gains import NOTEWORTHY, SIGNIFICANT, Gains
from tomo.scan import Corrections, Scan
from tomo.scan.corrections import correction_line

ALIKE = 0.1
"""Relative spread of the cameras' levels up to which one number stands for all of them."""

MOST_LISTED = 8
"""Cameras of a line; the largest corrections come first, and report.json has all."""


def dark_levels(
    pixels: PixelCheck | None, gains: Gains | None, names: Sequence[str]
) -> dict[str, float]:
    """Return by how much each camera's dark level is wrong, one figure a camera.

    Parameters
    ----------
    pixels : PixelCheck, optional
        What single images show.
    gains : Gains, optional
        Those that the images of ``names``, in this order, were corrected by.
    names : sequence of str

    Returns
    -------
    levels : dict
        Camera to a level in the unit of the images. That of the fit where there is one, which
        knows the volume; else that of the dark regions.
    """
    levels = dict(pixels.background) if pixels else {}
    if gains is not None:
        for view in _far(gains.offset, gains.offset_error, NOTEWORTHY * gains.scale).tolist():
            levels[names[view]] = float(gains.offset[view])
    return levels


def line_for_dark(
    levels: Mapping[str, float], names: Sequence[str], scan: Scan, *, fitted: bool
) -> str | None:
    """Return the one line on the cameras' dark level, with what to write; None where all is well.

    Parameters
    ----------
    levels : mapping
        See `dark_levels`.
    names : sequence of str
        All cameras, those too that take no part.
    scan : Scan
        Its corrections are already in the images. Darks that are images, flat fields and units of
        light leave no number to write.
    fitted : bool
        Whether gains and backgrounds were fitted.
    """
    if not levels:
        return None
    worst = max(levels, key=lambda name: abs(levels[name]))
    given = {name: scan.corrections.of("dark", name) for name in names}
    known = {name: 0.0 if dark is None else dark for name, dark in given.items()}
    found = (
        f"dark level: dark pixels of {len(levels)} of {len(names)} cameras' images are not 0, "
        f"camera {worst}'s are {levels[worst]:.3g}. "
    )
    numbers = all(isinstance(one, int | float) for one in known.values())
    flat = any(scan.corrections.of("flat", name) is not None for name in levels)
    if not numbers or flat or scan.radiometry is not None:
        return f"{found}Check the dark frames (scan.yaml, corrections: dark)"
    dark = {name: float(level) for name, level in known.items() if level}
    for name in sorted(levels, key=lambda name: -levels[name]):
        factor = scan.corrections.of("gain", name) or 1.0
        dark[name] = dark.get(name, 0.0) + levels[name] / factor
    values = np.array(list(dark.values()))
    alike = len(dark) == len(names) > 1 and np.ptp(values) <= ALIKE * abs(values.mean())
    line = correction_line("dark", float(values.mean()) if alike else dark)
    why = "fitted together with the gains" if fitted else "read off the images' dark regions"
    where = "write into scan.yaml, in place of any dark level there"
    return f"{found}To subtract them, {where}: {line}, {why}"


def line_for_gains(gains: Gains, names: Sequence[str], corrections: Corrections) -> str | None:
    """Return the line that corrects fitted gains in a scan's own numbers; None without one.

    Parameters
    ----------
    gains : Gains
        A camera's gain is the factor by which it records too much.
    names : sequence of str
        The cameras, in the order of the gains.
    corrections : Corrections
        Those of the scan, which are already in the images.
    """
    logs = np.log(gains.gain)
    factors = {
        names[view]: (corrections.of("gain", names[view]) or 1.0) / gains.gain[view]
        for view in _far(logs, gains.gain_error / gains.gain, NOTEWORTHY)[:MOST_LISTED].tolist()
    }
    return correction_line("gain", factors) if factors else None


def _far(
    values: NDArray[np.float64], errors: NDArray[np.float64], least: float
) -> NDArray[np.intp]:
    """Return the views whose value is real and large, the largest first."""
    size = np.abs(values)
    real = np.isfinite(errors) & (size > SIGNIFICANT * errors) & (size > least)
    order = np.argsort(-size, kind="stable")
    return order[real[order]]
