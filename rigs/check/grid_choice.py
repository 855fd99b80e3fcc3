"""The details that the views of a rig measure, and the voxels that suit them."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from rigs.check.resolved_wavelength import ResolvedWavelength, box_covariance, closing_view, short
from rigs.check.result import Finding, RigCheck

_VOXELS_A_WAVE = 8
"""Voxels along the waves of which the views measure half: four across a bright or a dark part.
Fewer smear what is measured, more add unknowns that no view tells apart."""

_ROUND = (1.0, 1.2, 1.5, 2.0, 2.5, 3.0, 4.0, 5.0, 6.0, 8.0, 10.0)  # digits of proposed voxels

_FINE_PIXEL = 0.3  # voxels; smaller pixels cost time and add nothing
_SHRUNK_PIXEL = 0.5  # voxels; the size that finer pixels are shrunk to
_COARSE_PIXEL = 1.5  # voxels; larger pixels do not resolve voxels
_UNLIKE = 2.0  # factor between a grid's voxels and the suitable ones up to which it is kept


def details(check: RigCheck) -> Iterator[Finding]:
    """Find the details that the views measure, and where a camera would close the largest gap."""
    found, resolved = check.coverage, check.resolved
    some = found.views >= 2
    if not some.any():
        return
    unit = found.rig.length_unit
    middle = found.points.mean(axis=0)
    point = np.flatnonzero(some)[np.linalg.norm(found.points[some] - middle, axis=1).argmin()]
    sees = found.seen[:, point]
    lines = found.directions[point][sees]
    text = resolved.words(unit)
    if resolved.is_coarse:
        text += ", as large as the volume itself: shapes along it are a guess"
    direction = closing_view(resolved.worst_direction, lines)
    if direction is not None and resolved.worst > resolved.half:
        away = float(np.median([figures.distance for figures in check.cameras]))
        position = _rounded(middle - away * direction, away)
        spot = ", ".join(f"{value:.6g}" for value in position)
        more = _with_camera_at(check, position)
        half, most, worst = map(short, (more.half, more.nine_tenths, more.worst))
        text += (
            f"; a camera at ({spot}), or opposite, would close the largest gap: half down to "
            f"{half} {unit}, 90 % to {most}, least {worst}"
        )
    if not resolved.is_coarse:
        yield Finding("note", text)
        return
    names = np.array(found.rig.names)[sees]
    neighbours = np.argsort(np.abs(lines @ resolved.worst_direction), kind="stable")[:2]
    yield Finding("warning", text, tuple(names[sorted(neighbours)].tolist()))


def _with_camera_at(check: RigCheck, position: NDArray[np.float64]) -> ResolvedWavelength:
    """Return what the views measure with one more camera, of the others' pixels."""
    views = check.coverage.views_of(box_covariance(check.extent), check.voxel)
    views = views.with_camera_at(position, check.coverage.points, check.coverage.median_footprint)
    return views.resolved(check.weights)


def _rounded(position: NDArray[np.float64], away: float) -> NDArray[np.float64]:
    """Return a position to two digits of its distance; a camera need not stand more exactly."""
    step = 10.0 ** math.floor(math.log10(away) - 1)
    return np.round(position / step) * step + 0.0


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
    """Return the voxel that suits, rounded: a ``pixel``'s width, or more where views resolve less.

    That is an eighth of the wavelength down to which half of all details are measured.
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
