"""The details that the views of a rig measure, and the camera that would close the largest gap."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from rigs.check.resolved_wavelength import ResolvedWavelength, box_covariance, closing_view
from rigs.check.result import Finding, RigCheck
from rigs.check.words import short


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
