"""Image sizes for formats whose files do not hold them."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path, PurePosixPath

from rigs.camera_protocol import CameraLike
from rigs.recordings import image_size

_ENDINGS = (".png", ".jpg", ".jpeg", ".tif", ".tiff", ".bmp", ".ppm", ".pgm")
MOST_RAYS = 2**24
"""Largest table of rays made from a formula: about 4 GB while it is made."""
MOST_TABLES = 4
"""How many of the largest tables one rig may have: 1.6 GB."""


def size_of_image(path: Path) -> tuple[int, int] | None:
    """Return width and height of an image, or None where there is none that can be read."""
    if not path.is_file():
        return None
    try:
        return image_size(path)
    except (OSError, ValueError):
        return None


def image_beside(folders: Iterable[Path], stem: str) -> Path | None:
    """Return the image of that stem in the first of some folders that has one, or None."""
    for folder in folders:
        for ending in _ENDINGS:
            if (folder / f"{stem}{ending}").is_file():
                return folder / f"{stem}{ending}"
    return None


def image_listed(folder: Path, name: str) -> tuple[PurePosixPath, Path]:
    """Return an image's name in a list and where to look for it: inside the list's folder.

    Lists come from other machines: of a path that is absolute or goes up the last part counts.
    """
    image = PurePosixPath(name.replace("\\", "/"))
    if image.is_absolute() or ".." in image.parts or ":" in name:  # C:/
        image = PurePosixPath(image.name)
    return image, folder / image


def required_size(
    given: tuple[int, int] | None, format_name: str, image: Path | None = None
) -> tuple[int, int]:
    """Return the size given, else that of ``image``; raise if neither is there."""
    size = given or (image and size_of_image(image))
    if not size:
        source = f", or the image {image} in the file's folder" if image else ""
        raise ValueError(
            f"image_size: missing, as {format_name} files hold none, "
            f"expected convert-rig's --image-size WIDTHxHEIGHT{source}"
        )
    return size


def check_tables(cameras: Iterable[CameraLike]) -> None:
    """Raise if the tables of rays among cameras are too many for their pixels.

    Raises
    ------
    ValueError
        Naming the sum. A short list of images would decide how much memory they take.
    """
    sizes = [camera.image_size for camera in cameras if not camera.has_lens_model]
    total = sum(width * height for width, height in sizes)
    if total > MOST_TABLES * MOST_RAYS:
        raise ValueError(
            f"image_size: found {len(sizes)} tables of rays with {total} pixels, expected at most "
            f"{MOST_TABLES * MOST_RAYS}: the lens is none of rig.yaml's, so keep fewer images or "
            "undistort them first"
        )


def check_table_size(size: tuple[int, int]) -> None:
    """Raise if a table of one ray per pixel would be far larger than any sensor's.

    Raises
    ------
    ValueError
        Naming the size. A few digits of a text file would decide how much memory it takes.
    """
    if size[0] * size[1] > MOST_RAYS:
        raise ValueError(
            f"image_size: found {size[0]} x {size[1]} pixels, expected at most {MOST_RAYS} "
            "for a camera that becomes a table of rays"
        )
