"""Headers of volumes: axes in any order and direction, and values in a file beside."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from rigs.files.size_guard import path_inside

HEADER = 1 << 16  # bytes of a text header, at most; longer ones take pynrrd seconds
_ASKEW = 1e-6  # of a step, off its world axis; more is 0.001 voxels over 1000, less is rounding


def in_order(
    data: NDArray,
    origin: NDArray[np.float64],
    steps: NDArray[np.float64],
    field: str,
    spacing: NDArray[np.float64] | None = None,
) -> tuple[NDArray, NDArray[np.float64], NDArray[np.float64]]:
    """Return values ``(nx, ny, nz)`` with axes along x, y and z, first voxel and spacing.

    ``steps`` ``(3, 3)``: row i leads from a voxel to the next along axis i of ``data``. Axes that
    run against the world's are flipped, and the origin moves to their other end.
    """
    steps = np.asarray(steps, np.float64)
    if spacing is not None and not (spacing > 0).all():
        return data, origin, spacing  # the grid says what is wrong with it
    found = f"{field}: found {steps.tolist()}, expected axes along x, y and z"
    if steps.shape != (3, 3) or not np.isfinite(steps).all():
        raise ValueError(found)
    world = np.abs(steps).argmax(axis=1)
    along = np.take_along_axis(steps, world[:, None], axis=1)[:, 0]
    off = np.abs(steps).sum(axis=1) - np.abs(along)
    if sorted(world) != [0, 1, 2] or (off > _ASKEW * np.abs(along)).any() or (along == 0).any():
        raise ValueError(found)
    origin = np.array(origin, np.float64)
    for axis, step in enumerate(along):
        if step < 0:
            data = np.flip(data, axis)
            origin[world[axis]] += (data.shape[axis] - 1) * step
    order = np.argsort(world)
    return data.transpose(order), origin, np.abs(along[order])


def numbers_in(text: str, field: str, count: int, dtype: type = np.float64) -> NDArray:
    """Return the numbers that a field of a header holds."""
    try:
        numbers: NDArray = np.array(text.split(), dtype)
    except (ValueError, OverflowError):
        numbers = np.zeros(0)
    if numbers.shape != (count,):
        kind = "whole numbers" if dtype is np.int64 else "numbers"
        raise ValueError(f"{field}: found {text[:60]!r}, expected {count} {kind}")
    return numbers


def content_beside(header: Path, name: object, field: str) -> bytes:
    """Return the content of the file that a field of a header names."""
    text = name if isinstance(name, str) else ""
    if not text or text.upper().startswith("LIST") or "%" in text:
        raise ValueError(f"{field}: found {str(name)[:60]!r}, expected the name of one file")
    path = path_inside(text, header.parent, field, "header's")
    if not path.is_file():
        raise ValueError(f"{field}: found no file {path.name} beside it, expected the values")
    return path.read_bytes()
