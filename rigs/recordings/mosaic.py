"""Mosaics of colour filters: the pixels of one colour are a smaller image with rays of its own."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, TypeVar

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from rigs.camera_protocol import CameraLike

    AnyCamera = TypeVar("AnyCamera", bound=CameraLike)

PATTERNS = ("RGGB", "BGGR", "GRBG", "GBRG")
"""Colours of the first row's two pixels, then of the second row's."""

COLOURS = ("r", "g", "g2", "b")
"""The four pixels of every 2 x 2: g is the green one of the first row, g2 that of the second."""


def is_channel(name: object) -> bool:
    """Return whether a name is that of a colour, or a number of a recording's channel."""
    return name in COLOURS or (isinstance(name, str) and name.isascii() and name.isdigit())


@dataclass(frozen=True)
class Mosaic:
    """The pixels of one colour of a sensor with a Bayer filter; nothing is interpolated.

    Every 2 x 2 pixels of the sensor have one of them: an image of half the width and height, in
    which every pixel keeps its own ray.

    Parameters
    ----------
    pattern : {"RGGB", "BGGR", "GRBG", "GBRG"}
        Colours of the first row's two pixels, then of the second row's, in the file.
    channel : {"r", "g", "g2", "b"}
        ``g`` is the green pixel of the first row, ``g2`` that of the second.

    Raises
    ------
    ValueError
        If one of them is unknown.

    Notes
    -----
    The mean of both green pixels along the ray in their middle would use all light, and is worse:
    on a turbulent flame in 8 views it raised the error from 0.091 to 0.115 without noise, from
    0.096 to 0.121 at 1 % noise and from 0.156 to 0.159 at 5 %. A mean over two pixels is not the
    light along the ray between them.

    Examples
    --------
    >>> import numpy as np
    >>> Mosaic("RGGB", "g").pixels(np.array([[9, 1], [3, 5]]))
    array([[1]])
    """

    pattern: str
    channel: str

    def __post_init__(self) -> None:
        """Check both names."""
        if self.pattern not in PATTERNS:
            known = ", ".join(PATTERNS)
            raise ValueError(f"bayer: found {self.pattern!r}, expected one of {known}")
        if self.channel not in COLOURS:
            known = ", ".join(COLOURS)
            raise ValueError(f"channel: found {self.channel!r}, expected one of {known}")

    @property
    def place(self) -> tuple[int, int]:
        """Row and column of the first pixel of the colour."""
        colour = self.channel[0].upper()
        find = self.pattern.rindex if self.channel == "g2" else self.pattern.index
        return divmod(find(colour), 2)

    def pixels(self, image: NDArray) -> NDArray:
        """Return the colour's pixels of an image, ``(height // 2, width // 2)``."""
        rows, columns = (side - side % 2 for side in image.shape)
        row, column = self.place
        return image[row:rows:2, column:columns:2]

    def camera(self, camera: AnyCamera) -> AnyCamera:
        """Return the camera of the colour's pixels, from the sensor's, of 2 x 2 pixels or more."""
        if min(camera.image_size) < 2:
            raise ValueError(
                f"camera {camera.name}: found {camera.image_size[0]} x {camera.image_size[1]} "
                "pixels, expected at least 2 x 2 of a mosaic of colours"
            )
        row, column = self.place
        # `shrunk` looks from the middle of the 2 x 2 pixels, at half a pixel
        return camera.shifted(0.5 - column, 0.5 - row).shrunk(2)

    def sensor(self, camera: AnyCamera) -> AnyCamera:
        """Return the camera of the whole sensor, but for an odd side, from the colour's."""
        row, column = self.place
        return camera.scaled(2).shifted(column - 0.5, row - 0.5)


def without_pattern(image: NDArray) -> NDArray[np.float32]:
    """Return a mosaic's brightness, at full size: every pixel is a mean over its 3 x 3.

    Edges stay where they are and become smoother: for the search of targets, not for intensities.
    The weights ``[1 2 1]^T [1 2 1] / 16`` give each of the four pixels of a Bayer pattern a
    quarter, wherever the 3 x 3 lie.
    """
    import cv2

    kernel = np.array([1, 2, 1], np.float32) / 4
    found = image.astype(np.float32)
    smooth = cv2.sepFilter2D(found, cv2.CV_32F, kernel, kernel, borderType=cv2.BORDER_REFLECT_101)
    return np.asarray(smooth, np.float32)
