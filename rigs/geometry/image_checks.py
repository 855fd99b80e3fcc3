"""Name, status and image size: their checks, and members common to every kind of camera."""

from __future__ import annotations

import math
import unicodedata
from dataclasses import replace
from typing import TYPE_CHECKING, Any, ClassVar, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rigs.figures import Accuracy, Optics

STATUSES = ("calibrated", "nominal", "virtual")


class OnImage:
    """A camera's members that follow from its image size alone; a camera is a dataclass."""

    if TYPE_CHECKING:
        __dataclass_fields__: ClassVar[dict[str, Any]]

        @property
        def image_size(self) -> tuple[int, int]: ...  # noqa: D102

        def cropped(self, x: int, y: int, width: int, height: int) -> Self: ...  # noqa: D102

        def scaled(self, scale: float) -> Self: ...  # noqa: D102

    def inside(self, uv: ArrayLike) -> NDArray[np.bool_]:
        """Return whether each of ``uv`` ``(N, 2)`` lies on the area of a pixel; NaN does not."""
        return on_image(uv, self.image_size)

    def renamed(self, name: str) -> Self:
        """Return the camera under another name."""
        return replace(self, name=name)

    def with_accuracy(self, accuracy: Accuracy | None) -> Self:
        """Return the camera of which another accuracy is known, or none."""
        return replace(self, accuracy=accuracy)

    def shrunk(self, factor: int) -> Self:
        """Return the camera of the image's area means over ``factor`` x ``factor`` pixels.

        Sides that ``factor`` does not divide lose their last rows or columns first.
        """
        width, height = (side - side % factor for side in self.image_size)
        return self.cropped(0, 0, width, height).scaled(1 / factor)


def check_name(name: object) -> None:
    """Raise unless ``name`` can name a camera, its files and its folder."""
    if (
        not isinstance(name, str)
        or name != name.strip()
        or name in ("", ".", "..")
        or any(c in "/\\" or unicodedata.category(c)[0] == "C" for c in name)
    ):
        raise ValueError(
            f"camera name: found {name!r}, expected text that can name a folder, without slashes"
        )


def image_size(size: Any, what: str) -> tuple[int, int]:
    """Return ``size`` as two plain integers."""
    try:
        width, height = (int(n) for n in size)
        is_whole = (width, height) == tuple(size)
    except (TypeError, ValueError, OverflowError):
        is_whole = False
    if not is_whole or min(width, height) < 1 or max(width, height) > 2**20:
        raise ValueError(
            f"{what}: image_size: found {size!r}, expected width and height, whole numbers "
            "from 1 to 1048576"
        )
    return width, height


def check_labels(camera: Any) -> str:
    """Raise unless name, optics, status and accuracy are a camera's; return what names it."""
    check_name(camera.name)
    what = f"camera {camera.name}"
    for name, kind in (("optics", Optics), ("accuracy", Accuracy)):
        found = getattr(camera, name)
        if found is not None and not isinstance(found, kind):
            raise ValueError(f"{what}: {name}: found {found!r}, expected {kind.__name__} or None")
    if camera.status not in STATUSES:
        raise ValueError(
            f"{what}: status: found {camera.status!r}, expected one of {', '.join(STATUSES)}"
        )
    return what


def rows_of(values: ArrayLike, columns: int, what: str) -> NDArray[np.float64]:
    """Return ``values`` as float64 ``(N, columns)``."""
    array = np.asarray(values, np.float64)
    if array.ndim != 2 or array.shape[1] != columns:
        raise ValueError(f"{what}: found shape {array.shape}, expected (N, {columns})")
    return array


def pixel_centres(size: tuple[int, int]) -> NDArray[np.float64]:
    """Return every pixel's (column, row), row by row, ``(width * height, 2)``."""
    width, height = size
    rows, columns = np.divmod(np.arange(width * height), width)
    return np.stack([columns, rows], axis=-1).astype(np.float64)


def on_image(uv: ArrayLike, size: tuple[int, int]) -> NDArray[np.bool_]:
    """Return whether each of ``uv`` ``(N, 2)`` is on the area of a pixel, ``(N,)``; NaN is not."""
    u, v = rows_of(uv, 2, "pixel coordinates").T
    width, height = size
    return (u >= -0.5) & (u < width - 0.5) & (v >= -0.5) & (v < height - 0.5)


def scaled_size(size: tuple[int, int], scale: float, what: str) -> tuple[int, int]:
    """Return the size of an image resized by ``scale``, rounded down."""
    if not (math.isfinite(scale) and scale > 0):
        raise ValueError(f"{what}: scale: found {scale}, expected positive")
    width, height = (math.floor(n * scale + 1e-6) for n in size)
    if min(width, height) < 1:
        raise ValueError(
            f"{what}: scale: found {scale}, which leaves nothing of {size[0]} x {size[1]} pixels"
        )
    return width, height


def check_window(window: tuple[int, int, int, int], size: tuple[int, int], what: str) -> None:
    """Raise unless ``window``, its column, row, width and height, lies inside an image."""
    x, y, width, height = window
    fits = all(int(n) == n for n in window) and min(x, y) >= 0 and min(width, height) >= 1
    if not (fits and x + width <= size[0] and y + height <= size[1]):
        raise ValueError(
            f"{what}: crop: found x, y, width, height = {window}, expected a window inside "
            f"{size[0]} x {size[1]} pixels"
        )


def quarter_turns(degrees: float, what: str) -> int:
    """Return how many quarter turns clockwise an image makes, 0 to 3."""
    if degrees not in (0, 90, 180, 270):
        raise ValueError(f"{what}: rotate: found {degrees}, expected 90, 180 or 270 degrees")
    return int(degrees) // 90
