"""The pictures of one moment: a volume's projections and slices, each on a scale that stays."""

from __future__ import annotations

import io
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tomo.draw import frame
from tomo.draw.volume.planes import coordinate, maximum_projections, middle_planes
from tomo.grid import VoxelGrid

COLOURS = "inferno"

LARGEST = 160
"""Pixels along a picture's longer side in a page: a film of 60 frames of six takes 10 MB at the
most, whatever the grid."""


@dataclass(frozen=True, eq=False)
class Panel:
    """A flat picture of a volume.

    Attributes
    ----------
    name : str
        What it shows, such as ``along z`` or ``y = 3``.
    values : (rows, columns)
        The row on top first.
    size : (float, float)
        Its width and height in the grid's unit.
    level, upright : str
        The axes across and up.
    """

    name: str
    values: NDArray
    size: tuple[float, float]
    level: str
    upright: str


def panels(volume: NDArray, grid: VoxelGrid, kinds: tuple[str, ...] = ()) -> list[Panel]:
    """Return the maximum projections along z, x and y, and the middle planes, as the kinds ask.

    Parameters
    ----------
    volume : (nx, ny, nz)
        NaN, of voxels that no camera sees, counts as dark.
    grid : VoxelGrid
    kinds : tuple of str
        Of `KINDS`; all by default.
    """
    volume = np.nan_to_num(volume, nan=0.0)
    found = []
    for kind in kinds or KINDS:
        for values, axes, extent, place in KINDS[kind](volume, grid):
            level, upright, across = (frame.NAMES[axis] for axis in axes)
            at = coordinate(place, extent)
            name = f"{across} = {at}" if kind == "slice" else f"maximum along {across}"
            size = extent[1] - extent[0], extent[3] - extent[2]
            found.append(Panel(name, values[::-1], size, level, upright))
    return found


KINDS = {"maximum": maximum_projections, "slice": middle_planes}
"""Kind to what makes it: maxima along lines, and middle planes. They share one scale, which line
integrals do not: along a flame's axis these are far brighter than across it."""


def coloured(values: NDArray, highest: float) -> NDArray[np.uint8]:
    """Return values from 0 to ``highest`` as steps of the colour scale, 0 to 255."""
    return np.clip(values * (255 / highest) + 0.5, 0, 255).astype(np.uint8)


def palette() -> NDArray[np.uint8]:
    """Return the 256 colours of the scale, ``(256, 3)``."""
    from matplotlib import colormaps

    return (colormaps[COLOURS](np.arange(256))[:, :3] * 255 + 0.5).astype(np.uint8)


def shrunk(values: NDArray, longest: int = LARGEST) -> NDArray:
    """Return a picture of at most so many pixels along each side, by area means."""
    import cv2

    factor = longest / max(values.shape)
    if factor >= 1:
        return values
    size = [max(round(n * factor), 1) for n in values.shape[::-1]]
    return cv2.resize(np.ascontiguousarray(values, np.float32), size, interpolation=cv2.INTER_AREA)


def png_of(steps: NDArray[np.uint8]) -> bytes:
    """Return steps of the colour scale as a PNG with a palette."""
    from PIL import Image

    image = Image.fromarray(steps)
    image.putpalette(palette().tobytes())
    buffer = io.BytesIO()
    image.save(buffer, "png", optimize=True)
    return buffer.getvalue()
