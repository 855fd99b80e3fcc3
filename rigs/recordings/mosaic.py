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

STEP = 2
"""Rows, and columns, from a pixel to the next of its colour."""


@dataclass(frozen=True)
class Mosaic:
    """The pixels of one colour of a sensor with a Bayer filter; nothing is interpolated.

    Each 2 x 2 pixels of the sensor become one: its red or blue pixel, or the mean of its two
    green ones, which is the light in their middle.

    Parameters
    ----------
    pattern : {"RGGB", "BGGR", "GRBG", "GBRG"}
        Colours of the first row's two pixels, then of the second row's, in the file.
    channel : {"r", "g", "b"}

    Raises
    ------
    ValueError
        If one of them is unknown.

    Examples
    --------
    >>> import numpy as np
    >>> Mosaic("RGGB", "g").means(np.array([[9.0, 1.0], [3.0, 5.0]]))
    array([[2.]])
    """

    pattern: str
    channel: str

    def __post_init__(self) -> None:
        """Check both names."""
        if self.pattern not in PATTERNS:
            raise ValueError(
                f"bayer: found {self.pattern!r}, expected one of {', '.join(PATTERNS)}"
            )
        if self.channel not in ("r", "g", "b"):
            raise ValueError(f"channel: found {self.channel!r}, expected r, g or b")

    @property
    def places(self) -> list[tuple[int, int]]:
        """Rows and columns of the colour's pixels in the first 2 x 2 of the image."""
        return [divmod(n, STEP) for n, c in enumerate(self.pattern) if c == self.channel.upper()]

    def means(self, image: NDArray[np.floating]) -> NDArray[np.floating]:
        """Return the colour's image ``(height // 2, width // 2)``."""
        return np.mean(self._planes(image), axis=0, dtype=np.float64).astype(image.dtype)

    def all(self, flags: NDArray[np.bool_]) -> NDArray[np.bool_]:
        """Return where all of a pixel's own ``flags`` hold, ``(height // 2, width // 2)``."""
        return np.all(self._planes(flags), axis=0)

    def any(self, flags: NDArray[np.bool_]) -> NDArray[np.bool_]:
        """Return where any of a pixel's own ``flags`` holds, ``(height // 2, width // 2)``."""
        return np.any(self._planes(flags), axis=0)

    def camera(self, camera: AnyCamera) -> AnyCamera:
        """Return the camera of the colour's image, from that of the sensor's.

        Raises
        ------
        ValueError
            If the image is narrower or lower than two pixels.
        """
        if min(camera.image_size) < STEP:
            raise ValueError(
                f"camera {camera.name}: found {camera.image_size[0]} x {camera.image_size[1]} "
                "pixels, expected at least 2 x 2 of a mosaic of colours"
            )
        row, column = np.mean(self.places, axis=0).tolist()
        # `shrunk` looks from the middle of the 2 x 2 pixels, at half a pixel
        return camera.shifted(0.5 - column, 0.5 - row).shrunk(STEP)

    def _planes(self, image: NDArray) -> list[NDArray]:
        rows, columns = (side - side % STEP for side in image.shape)
        return [image[row:rows:STEP, column:columns:STEP] for row, column in self.places]


def without_pattern(image: NDArray) -> NDArray[np.float32]:
    """Return a mosaic's brightness, at full size: every pixel is a mean over its 3 x 3.

    Edges stay where they are and become smoother: for the search of targets, not for intensities.

    Notes
    -----
    The weights ``[1 2 1]^T [1 2 1] / 16`` give each of the four pixels of a Bayer pattern a
    quarter, wherever the 3 x 3 lie.
    """
    import cv2

    kernel = np.array([1, 2, 1], np.float32) / 4
    found = image.astype(np.float32)
    return cv2.sepFilter2D(found, cv2.CV_32F, kernel, kernel, borderType=cv2.BORDER_REFLECT_101)
