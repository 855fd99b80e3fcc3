"""What a check takes cameras to be accurate to, where nobody has measured it."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from rigs.check.coverage import PIXEL_ACCURACY
from rigs.check.result import Finding, RigCheck
from rigs.check.words import short
from rigs.files.units import UNKNOWN, metres

_RULER = 1e-3  # metres; the error of a position taken with a ruler

_UNMEASURED = {
    "nominal": (
        "warning",
        "nominal cameras: how exact they are is not known",
        "give --pixel-accuracy, calibrate them (calibrate-rig), or reconstruct with "
        "--refine-cameras nominal",
    ),
    "calibrated": (
        "note",
        "the calibration does not say how exact it is",
        "give --pixel-accuracy, or reconstruct with --refine-cameras all to see whether the "
        "images agree",
    ),
}
"""Level, meaning and cure for cameras of each status; virtual ones are exact."""


def assumed_accuracy(check: RigCheck) -> Iterator[Finding]:
    """Say which accuracy was assumed for cameras that nobody has measured."""
    rig = check.coverage.rig
    if check.pixel_accuracy is not None or check.ray_miss_from == "calibration":
        return
    sizes = np.array([figures.footprint for figures in check.cameras])
    for status, (level, meaning, cure) in _UNMEASURED.items():
        own = np.array([camera.status == status for camera in rig])
        if not np.isfinite(sizes[own]).any():
            continue
        pixel, unit = float(np.nanmedian(sizes[own])), rig.length_unit
        text = (
            f"{meaning}; {PIXEL_ACCURACY:g} of a pixel was assumed, "
            f"{short(PIXEL_ACCURACY * pixel)} {unit} in the volume"
        )
        if unit != UNKNOWN:
            text += f"; 1 mm, as by a ruler, is {short(_RULER / metres(unit) / pixel)} pixels here"
        names = tuple(name for name, is_one in zip(rig.names, own, strict=True) if is_one)
        yield Finding(level, f"{text}: {cure}", () if own.all() else names)
