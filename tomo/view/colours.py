"""Numbers as pictures: planes of a volume, photographs, and three of them beside each other."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from tomo.draw.rig.thumbnails import shrunk
from tomo.draw.scene import ColourScale
from tomo.grid import VoxelGrid

COLOURS = ("inferno", "viridis", "magma", "turbo", "gray")
"""Colour maps to choose from."""

_LONGEST_PLANE = 512  # pixels of a plane's longer side: finer does not show
_GROUND = 36  # grey of the page's panels
_GAP = 6  # pixels between pictures
_HEADING = 22  # pixels above a picture


def painted(values: NDArray, scale: ColourScale) -> NDArray[np.uint8]:
    """Return red, green, blue ``(..., 3)`` of values, by a table of 256 colours."""
    colours = scale(np.linspace(scale.lower, scale.upper, 256))
    table = np.round(255 * colours).astype(np.uint8)
    span = scale.upper - scale.lower
    ratio = (np.nan_to_num(values) - scale.lower) * (255 / span)
    return table[np.clip(np.round(ratio), 0, 255).astype(np.uint8)]


def plane_values(data: NDArray, grid: VoxelGrid, axis: int, at: float) -> NDArray[np.float32]:
    """Return the values on a plane across an axis, ``(second axis, first axis)``.

    The first axis follows ``axis`` in the order x, y, z, x; the second follows the first. Between
    two layers of voxels the values are interpolated linearly.

    Parameters
    ----------
    data : (nx, ny, nz)
    grid : VoxelGrid
    axis : int
    at : float
        World coordinate along the axis; outside the grid the outermost layer is returned.
    """
    place = (at - grid.origin[axis]) / grid.spacing[axis]
    place = float(np.clip(place, 0, grid.shape[axis] - 1))
    below = min(int(place), max(grid.shape[axis] - 2, 0))
    above = min(below + 1, grid.shape[axis] - 1)
    part = np.float32(place - below)
    plane = np.take(data, below, axis=axis) * (1 - part) + np.take(data, above, axis=axis) * part
    plane = np.asarray(plane, np.float32)  # axes in the order x, y, z without `axis`
    return plane if axis == 1 else plane.T


def plane_picture(
    data: NDArray, grid: VoxelGrid, axis: int, at: float, scale: ColourScale
) -> NDArray[np.uint8]:
    """Return `plane_values` in colours, at most 512 pixels long."""
    return painted(shrunk(plane_values(data, grid, axis, at), _LONGEST_PLANE), scale)


def photographs(images: Mapping[str, NDArray], longest: int) -> dict[str, NDArray[np.uint8]]:
    """Return images as grey pictures ``(rows, columns, 3)`` of one brightness, shrunk.

    The brightest 0.1 % of all pixels together are white.
    """
    small = {
        name: shrunk(np.asarray(image, np.float32), longest) for name, image in images.items()
    }
    if not small:
        return {}
    bright = float(np.quantile(np.concatenate([one.ravel() for one in small.values()]), 0.999))
    scale = ColourScale("", 0.0, bright if bright > 0 else 1.0, "gray")
    return {name: painted(one, scale) for name, one in small.items()}


def beside_each_other(
    pictures: Sequence[NDArray[np.uint8]], headings: Sequence[str], longest: int = 300
) -> NDArray[np.uint8]:
    """Return pictures ``(rows, columns, 3)`` of one size in a row, each with its heading."""
    import cv2

    shown = []
    for picture, heading in zip(pictures, headings, strict=True):
        rows, columns = picture.shape[:2]
        factor = longest / max(rows, columns)
        size = (max(1, round(columns * factor)), max(1, round(rows * factor)))
        how = cv2.INTER_AREA if factor < 1 else cv2.INTER_NEAREST
        image = cv2.resize(picture, size, interpolation=how)
        wide = max(size[0], 150)
        panel = np.full((size[1] + _HEADING, wide, 3), _GROUND, np.uint8)
        panel[_HEADING:, (wide - size[0]) // 2 :][:, : size[0]] = image
        cv2.putText(
            panel, heading, (1, _HEADING - 7), cv2.FONT_HERSHEY_SIMPLEX, 0.42, (205, 210, 215), 1,
            cv2.LINE_AA,
        )  # fmt: skip
        shown += [panel, np.full((len(panel), _GAP, 3), _GROUND, np.uint8)]
    return np.concatenate(shown[:-1], axis=1)
