"""Where an NRRD's voxels are: by directions in a space, or by a spacing and ends of each axis."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tomo.io._axes import in_order

_AGREE = 1e-3  # of a length that stands twice: files hold some four digits
_CELL, _UNKNOWN = "cell", ("???", "none", "")


def located(header: dict[str, Any], data: NDArray) -> tuple[NDArray, NDArray, NDArray, str]:
    """Return values ``(nx, ny, nz)``, the centre of voxel (0, 0, 0), spacing and length unit.

    An axis without a centering is taken by nodes, as Teem takes it: its ends are the centres of
    the first and the last voxel. Those of cells are the voxels' outer faces.
    """
    unit = _unit(header)
    if "space directions" in header:
        origin = np.asarray(header.get("space origin", np.zeros(3)))
        if origin.shape != (3,):
            raise ValueError(f"space origin: found shape {origin.shape}, expected three numbers")
        steps = np.asarray(header["space directions"])
        return *in_order(data, origin, steps, "space directions"), unit
    spacings, mins, maxs = (_each(header, name) for name in ("spacings", "axis mins", "axis maxs"))
    axes = [
        _axis(*values)
        for values in zip(spacings, mins, maxs, _centerings(header), data.shape, strict=True)
    ]
    origin = np.array([first for first, _ in axes])
    if "space origin" in header:
        origin = header["space origin"]
    steps = np.array([step for _, step in axes])
    if any(known is not None and not known > 0 for known in spacings):
        return data, origin, steps, unit  # the grid says what is wrong with them
    return *in_order(data, np.asarray(origin), np.diag(steps), "axis mins"), unit


def _each(header: dict[str, Any], name: str) -> Sequence[float | None]:
    """Return a field's number for each axis; None where there is none."""
    found = header.get(name, header.get(name.replace(" ", "")))
    if found is None:
        return (None, None, None)
    if np.shape(found) != (3,):
        raise ValueError(f"{name}: found shape {np.shape(found)}, expected three numbers")
    numbers = [float(one) for one in found]
    if name == "spacings":
        return numbers
    return [None if math.isnan(one) else one for one in numbers]


def _centerings(header: dict[str, Any]) -> list[bool]:
    """Return for each axis whether its ends are those of cells."""
    words = header.get("centerings", header.get("centers", ()))
    words = words.split() if isinstance(words, str) else list(words)
    if any(word not in (_CELL, "node", *_UNKNOWN) for word in words) or len(words) not in (0, 3):
        raise ValueError(f"centerings: found {words[:4]}, expected cell or node for each axis")
    return [word == _CELL for word in words or ("", "", "")]


def _axis(
    spacing: float | None, low: float | None, high: float | None, of_cells: bool, count: int
) -> tuple[float, float]:
    """Return the position of the first voxel's centre and the way to the next one."""
    intervals = count if of_cells else count - 1
    if low is None or high is None:
        step = 1.0 if spacing is None else spacing
        if low is None:
            if high is None:
                return 0.0, step
            low = high - step * intervals
    else:
        if spacing is None:
            step = (high - low) / intervals if intervals else 1.0
        else:
            step = -spacing if high < low else spacing
        if not abs(high - low - step * intervals) <= _AGREE * abs(step) * max(intervals, 1):
            raise ValueError(
                f"axis maxs: found {high:g}, expected {low + step * intervals:g} by axis mins, "
                f"spacings and {'cells' if of_cells else 'nodes'}"
            )
    return low + (step / 2 if of_cells else 0.0), step


def _unit(header: dict[str, Any]) -> str:
    """Return the unit of length, one for all axes."""
    units = header.get("space units") or header.get("units") or ["mm"]
    if len(set(units)) > 1:
        raise ValueError(f"space units: found {units}, expected one unit for all axes")
    return str(units[0]) or "mm"
