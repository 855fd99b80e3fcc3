"""Voxels and pixels against each other, and the grid that suits what the views resolve."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np

from rigs.check.result import Finding, RigCheck
from rigs.check.words import short

_VOXELS_A_WAVE = 8
"""Voxels along the waves of which the views measure half: four across a bright or a dark part.
Fewer smear what is measured, more add unknowns that no view tells apart."""

_ROUND = (1.0, 1.2, 1.5, 2.0, 2.5, 3.0, 4.0, 5.0, 6.0, 8.0, 10.0)  # digits of proposed voxels

_FINE_PIXEL = 0.3  # voxels; smaller pixels cost time and add nothing
_SHRUNK_PIXEL = 0.5  # voxels; the size that finer pixels are shrunk to
_COARSE_PIXEL = 1.5  # voxels; larger pixels do not resolve voxels
_UNLIKE = 2.0  # factor between a grid's voxels and the suitable ones up to which it is kept


def grid_choice(check: RigCheck) -> Iterator[Finding]:
    """Find voxels unlike those that pixels and views resolve, and name options that suit."""
    sizes = np.array([figures.footprint_in_voxels for figures in check.cameras])
    known = np.isfinite(sizes)
    if not known.any():
        return
    typical = float(np.median(sizes[known]))
    pixel, unit = typical * check.voxel, check.coverage.rig.length_unit
    voxel = suitable_voxel(check, pixel)
    is_kept = 1 / _UNLIKE <= check.voxel / voxel <= _UNLIKE
    if typical > _COARSE_PIXEL:
        text = f"a pixel is {short(typical)} voxels wide: the images resolve no finer voxels"
        yield Finding("warning", f"{text}{_options(check, pixel, voxel)}")
    elif not is_kept or typical < _FINE_PIXEL:
        text = f"the views resolve half of all details down to {short(check.resolved.half)} {unit}"
        text += f", a pixel is {short(pixel)} {unit}, a voxel {short(check.voxel)} {unit}"
        options = _options(check, pixel, check.voxel if is_kept else voxel)
        yield Finding("note", f"{text}{options}")
    names = np.array(check.coverage.rig.names)
    coarse = known & (sizes > max(2 * typical, 1.0))
    for name, size in zip(names[coarse], sizes[coarse], strict=True):
        text = f"pixels {short(size)} voxels wide, those of most cameras {typical:.2g}"
        yield Finding("warning", text, (str(name),))


def suitable_voxel(check: RigCheck, pixel: float) -> float:
    """Return the voxel that suits: as wide as a pixel, wider where the views resolve less.

    It is the larger one of a ``pixel`` and an eighth of the wavelength down to which half of all
    details are measured, rounded.
    """
    half = check.resolved.half
    wanted = max(pixel, half / _VOXELS_A_WAVE) if math.isfinite(half) else pixel
    power = math.floor(math.log10(wanted))
    digits = min(_ROUND, key=lambda one: abs(one - wanted / 10.0**power))
    return float(f"{digits}e{power}")  # as text says it: 0.3, not 0.30000000000000004


def shrinkable(pixel: float) -> int | None:
    """Return by how much images may be shrunk whose pixels are ``pixel`` voxels wide; None: not.

    Two pixels a voxel are left.
    """
    scale = int(_SHRUNK_PIXEL / pixel)
    return scale if pixel < _FINE_PIXEL and scale > 1 else None


def _options(check: RigCheck, pixel: float, voxel: float) -> str:
    """Return the options of such voxels, and of images shrunk to half of one, in words."""
    counts = np.ceil(check.extent / voxel - 1e-6).astype(int)
    text = f": try --grid {'x'.join(map(str, counts))} --spacing {voxel:g}"
    lower, upper = check.coverage.points.min(axis=0), check.coverage.points.max(axis=0)
    center = np.round((lower + upper) / 2 / check.voxel, 3) * check.voxel + 0.0
    if center.any():
        text += f" --center {','.join(f'{value:.6g}' for value in center)}"
    if (scale := shrinkable(pixel / voxel)) is not None:
        text += f" --scale {scale}"
    return text
