"""The light of a volume as a virtual camera sees it: line integrals in colours, on black."""

from __future__ import annotations

import io
import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rigs import Camera, Rig
from tomo.draw.figures import raised
from tomo.draw.frame import UP, Up, Viewpoint
from tomo.draw.scene import ColourScale
from tomo.draw.shapes import box_corners
from tomo.draw.volume.isosurface import coarsened, finite
from tomo.grid import Volume, VoxelGrid

COLOURS = "inferno"
EYE = (28.0, 12.0)
"""Azimuth and elevation in degrees from which a volume alone is seen: nearly level, as a camera
beside a flame."""

_SMALL, _ENOUGH_VOXELS = (64, 64), 1_000_000
"""Pixels and voxels of the pictures that find the brightest integral."""

_FINE_PIXELS, _MOST_VOXELS = 3.0, 16_000_000
"""Pixels that a voxel may be wide before it is divided, unless there were more voxels then: wider
ones show their edges, narrower ones cost time."""


@dataclass(frozen=True)
class Looks:
    """How a volume is drawn.

    Attributes
    ----------
    levels : tuple of float
        Up to three parts of the maximum: surfaces are drawn there in place of the light.
    colours : str
        A colour map of matplotlib.

    Raises
    ------
    ValueError
        If a level is not between 0 and 1, there are more than three, or no colour map is so named.
    """

    levels: tuple[float, ...] = ()
    colours: str = COLOURS

    def __post_init__(self) -> None:
        """Check both."""
        if len(self.levels) > 3 or not all(0 < level < 1 for level in self.levels):
            found = ", ".join(f"{level:g}" for level in self.levels)
            raise ValueError(f"level: found {found}, expected up to three numbers between 0 and 1")
        if self.colours != COLOURS:
            from matplotlib import colormaps

            if self.colours not in colormaps:
                raise ValueError(
                    f"colormap: found {self.colours!r}, expected one of matplotlib's, like inferno"
                )


LIGHT = Looks()
"""Light in the usual colours."""


def emission_image(volume: Volume, viewpoint: Viewpoint) -> NDArray[np.float32]:
    """Return the volume's line integrals through the middles of a picture's pixels.

    Emission is linear between the centres of voxels, 0 where not finite. The projection operator
    without a stored matrix integrates it, on voxels divided until their edges do not show.

    Returns
    -------
    image : (height, width) float32
        Value times length; 0 where a pixel's line misses the volume.
    """
    from scipy.ndimage import zoom

    from tomo.operators import LinearSystem
    from tomo.operators.system import VolumeNotSeenError

    grid, data = volume.grid, np.asarray(finite(volume))
    wide = max(grid.spacing) / viewpoint.pixel_at(grid.center)
    most = (_MOST_VOXELS / grid.size) ** (1 / 3)
    times = int(min(max(math.ceil(wide / _FINE_PIXELS), 1), max(most, 1), 8))
    if times > 1:
        data = zoom(data, times, order=1, mode="nearest", grid_mode=True)
        grid = VoxelGrid(data.shape, np.divide(grid.spacing, times), grid.center)
    (right, down), focal = viewpoint.principal, viewpoint.focal
    matrix = [[focal, 0, right], [0, focal, down], [0, 0, 1]]
    eye = Camera(
        "eye", viewpoint.size, matrix, R=viewpoint.axes, t=-viewpoint.axes @ viewpoint.eye
    )
    image = np.zeros(viewpoint.size[::-1], np.float32)
    try:
        system = LinearSystem.from_rig(Rig((eye,)), grid, form="on-the-fly")
    except VolumeNotSeenError:
        return image
    image.flat[system.pixels[0]] = system.projector @ data.ravel()
    return image


def brightest_integral(volume: Volume, up: Up) -> float:
    """Return the end of the colours of line integrals: a round number at or above the brightest.

    It is the brightest of those that are seen while the volume turns about the upward axis, see
    `eye_of`. Along a flat volume an eye looks through more, and sees the last colour there.
    """
    small = coarsened(finite(volume), _ENOUGH_VOXELS)
    images = (
        emission_image(small, eye_of(volume.grid, _SMALL, EYE[0] + turn, up))
        for turn in range(0, 180, 45)
    )
    return end_of_scale(max(float(image.max()) for image in images))


def end_of_scale(most: float) -> float:
    """Return the round number at or above the largest one; 1 where there is none above zero.

    >>> end_of_scale(7.1), end_of_scale(0.0)
    (8.0, 1.0)
    """
    if not (most > 0 and math.isfinite(most)):
        return 1.0
    power = 10.0 ** math.floor(math.log10(most))
    steps = np.array([1, 1.25, 1.5, 2, 2.5, 3, 4, 5, 6, 8, 10]) * power
    return float(steps[min(int(np.searchsorted(steps, most)), len(steps) - 1)])


def of_integral(value_unit: str, length_unit: str) -> str:
    """Return the unit of integrals along a line.

    >>> of_integral("counts per mm", "mm"), of_integral("", "mm")
    ('counts', 'emission × mm')
    """
    unit = value_unit.removesuffix(f" per {length_unit}")
    return raised(unit if unit != value_unit else f"{value_unit or 'emission'} × {length_unit}")


def eye_of(
    grid: VoxelGrid,
    size: tuple[int, int],
    azimuth: float = EYE[0],
    up: Up = UP,
    margins: tuple[float, float, float, float] = (0.03, 0.03, 0.03, 0.03),
) -> Viewpoint:
    """Return the viewpoint from which the box fills a picture as it turns about the upward axis.

    ``size`` is width and height in pixels, ``azimuth`` in degrees; ``margins`` are the fractions
    of width and height that stay free: left, right, top, bottom.
    """
    toward = up.eye_direction(azimuth, EYE[1])
    corners = box_corners(grid.lower, grid.upper) - grid.center
    first, second = up.level
    around = np.hypot(*grid.extent[[first, second]]) / 2
    angles = np.radians(np.arange(0, 360, 22.5))
    rings = np.repeat(corners[[0, -1]], len(angles), axis=0)
    rings[:, first] = np.tile(around * np.cos(angles), 2)
    rings[:, second] = np.tile(around * np.sin(angles), 2)
    points = np.vstack([corners, rings]) + grid.center
    return Viewpoint.framing(points, toward, up.vector, size, margins, distance=6)


def turning_gif(
    volume: Volume, *, colours: str = COLOURS, height: int = 400, frames: int = 36
) -> bytes:
    """Return an animation of the volume's light turning once about the upward axis, as GIF.

    ``colours`` is a colour map of matplotlib, its first colour the ground; the width follows from
    ``height`` in pixels and the box.
    """
    from PIL import Image

    grid = volume.grid
    wide = np.hypot(*grid.extent[list(UP.level)])
    width = int(np.clip(round(height * wide / grid.extent[UP.axis]), height // 4, 2 * height))
    scale = ColourScale("", 0.0, 1.0, colours)
    palette = np.round(255 * scale(np.linspace(0, 1, 256))).astype(np.uint8)
    images = [
        emission_image(volume, eye_of(grid, (width, height), azimuth))
        for azimuth in EYE[0] + np.arange(frames) * 360 / frames
    ]
    brightest = max(float(image.max()) for image in images) or 1.0
    pictures = []
    for image in images:
        # every other step of the colours: half the file, and no eye sees it
        steps = np.clip(np.round(image * (127 / brightest)), 0, 127).astype(np.uint8) * 2
        picture = Image.fromarray(steps)
        picture.putpalette(palette.tobytes())
        pictures.append(picture)
    buffer = io.BytesIO()
    pictures[0].save(
        buffer, "gif", save_all=True, append_images=pictures[1:], duration=90, loop=0,
        optimize=False, disposal=1,
    )  # fmt: skip
    return buffer.getvalue()
