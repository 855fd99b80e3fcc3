"""The voxels that coordinates along x, y and z describe, as xarray holds them."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from xarray import DataArray, Dataset

AXES = ("x", "y", "z")

UNEVEN = 1e-6
"""Fraction of a voxel by which coordinates may miss even steps: text of eight digits does."""


def voxels_of(array: DataArray | Dataset) -> tuple[tuple[int, ...], list[float], list[float]]:
    """Return shape, spacing and centre of the voxels whose centres are the coordinates x, y, z.

    Spacing and centre among the attributes, alone or in a mapping ``grid``, are taken where the
    coordinates agree with them: exact to the last bit. Coordinates may descend, and are refused
    unless each is along one dimension of its name, finite and evenly spaced.
    """
    own: Mapping[str, Any] = array.attrs.get("grid", array.attrs)
    shape, spacing, center = [], [], []
    for number, name in enumerate(AXES):
        if name not in array.coords or array.coords[name].dims != (name,):
            found = ", ".join(map(str, array.dims)) or "none"
            raise ValueError(
                f"coordinates: {name}: found none (dimensions are {found}), expected x, y and z "
                "with the centres of the voxels along each"
            )
        values = np.asarray(array.coords[name].values)
        if values.dtype.kind not in "fiu" or not len(values):
            raise ValueError(f"coordinates: {name}: found {values.dtype}, expected some numbers")
        step, middle = _even_steps(name, values, *_noted(own, number))
        shape.append(len(values))
        spacing.append(step)
        center.append(middle)
    return tuple(shape), spacing, center


def descending(array: DataArray | Dataset) -> list[str]:
    """Return the names of the axes whose coordinates descend."""
    ends = {name: array.coords[name].values[[0, -1]] for name in AXES}
    return [name for name, (first, last) in ends.items() if first > last]


def _even_steps(
    name: str, values: NDArray, step: float | None, middle: float | None
) -> tuple[float, float]:
    """Return the step between coordinates and their middle, those noted where they agree."""
    rough = np.finfo(values.dtype).eps if values.dtype.kind == "f" else 0.0
    values = np.sort(values.astype(np.float64)) if values[0] > values[-1] else values
    values = values.astype(np.float64)
    count = len(values)
    if count > 1:
        found = float(values[-1] - values[0]) / (count - 1)
    elif step is not None:
        found = step
    else:
        raise ValueError(
            f"coordinates: {name}: found {values[0]:g} alone, expected two or more, or the edge "
            "lengths of a voxel in attrs['spacing']"
        )
    slack = UNEVEN * abs(found) + 4 * rough * np.abs(values).max()
    misses = np.abs(values - (values[0] + found * np.arange(count)))
    if not (found > 0 and misses.max() <= slack):  # NaN is none of both
        raise ValueError(
            f"coordinates: {name}: found steps from {np.diff(values).min():.6g} to "
            f"{np.diff(values).max():.6g}, expected even ones, the edge length of a voxel"
        )
    if step is not None and abs(step - found) * count <= slack:
        found = step
    at = float(values[0] + (count - 1) / 2 * found)
    return found, middle if middle is not None and abs(middle - at) <= slack else at


def _noted(own: Mapping[str, Any], number: int) -> tuple[float | None, float | None]:
    """Return the spacing and the centre along an axis that attributes hold, None where none."""
    noted = []
    for name in ("spacing", "center"):
        try:
            values = np.asarray(own.get(name), np.float64)
        except (TypeError, ValueError):
            values = np.zeros(0)
        good = values.shape == (3,) and np.isfinite(values).all()
        noted.append(float(values[number]) if good else None)
    return noted[0], noted[1]
