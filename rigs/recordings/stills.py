"""The one reader of still images: pixels and sizes, decoded by libraries behind one guard.

TIFF is read by tifffile, PNG by imagecodecs, PGM and PPM here, all other formats and their headers
by Pillow.

Lines on images that are read as they are, though their files say something of them.

Grey images onto disk: TIFF for any numbers, PNG for integers.
"""

from __future__ import annotations

import contextlib
import io
import os
import warnings
from collections import Counter
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, BinaryIO, cast

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rigs.files import atomic_path
from rigs.files.size_guard import check_claim, errors_of_libraries
from rigs.files.text import check_plain_file, some
from rigs.recordings.netpbm import is_netpbm, netpbm_size, read_netpbm
from rigs.recordings.still import Still
from rigs.recordings.tiff import TIFF_MARKS, image_page, opened_tiff, read_tiff, tiff_page

if TYPE_CHECKING:
    import tifffile
    from PIL import Image

IMAGE_SUFFIXES = (".tif", ".tiff", ".png", ".jpg", ".jpeg", ".bmp", ".pgm", ".ppm", ".webp")
"""Usual suffixes of the formats that `read_still` reads."""

_FORMATS = ("PNG", "JPEG", "BMP", "PPM", "WEBP")
_MODES = {"1": "L", "L": "L", "I": "I", "F": "F", "RGBA": "RGBA"}
"""Pillow's modes of images that are not PNG, to those that are decoded; all others become RGB."""


def read_still(path: str | os.PathLike) -> Still:
    """Return an image file's pixels as stored.

    Parameters
    ----------
    path : path-like
        A TIFF, PNG, JPEG, BMP, PGM, PPM or WebP file; its content tells which.

    Returns
    -------
    still : Still
        Row 0 first, whatever the file says about the way it is viewed; `image_notes` tells. A
        palette is replaced by its colours.

    Raises
    ------
    ValueError
        If the file is no image of intensities, is truncated or damaged, or claims to be far
        larger than it is.
    OSError
        If the file cannot be opened.

    Notes
    -----
    JPEG has no check sum: data damaged inside are decoded as they are. TIFF and PNG are the
    formats for measurements.
    """
    path = Path(path)
    check_plain_file(path)
    content = path.read_bytes()
    with errors_of_libraries(f"{path}: not a readable image"):
        if content.startswith(TIFF_MARKS):
            return read_tiff(content)
        return read_netpbm(content) if is_netpbm(content) else Still.of(_decode(content))


def image_size(path: str | os.PathLike) -> tuple[int, int]:
    """Return the width and height in pixels that an image file claims; no pixel is decoded."""
    path = Path(path)
    check_plain_file(path)
    with path.open("rb") as file, errors_of_libraries(f"{path}: not a readable image"):
        head = file.read(2)
        file.seek(0)
        if is_netpbm(head):
            return netpbm_size(file.read())
        if head not in TIFF_MARKS:
            return header_of(file if head else b"").size
        with tiff_page(file) as page:
            return page.imagewidth, page.imagelength


def luminance(pixels: NDArray) -> NDArray:
    """Return the grey image ``(rows, columns)`` of the pixels of a `Still`.

    ``0.299 R + 0.587 G + 0.114 B`` (ITU-R BT.601); alpha is ignored.
    """
    if pixels.ndim == 2 or pixels.shape[2] <= 2:
        return pixels.reshape(*pixels.shape[:2], -1)[:, :, 0]
    import cv2

    if pixels.dtype not in (np.uint8, np.uint16):
        pixels = pixels.astype(np.float32)  # OpenCV converts no other type
    return cv2.cvtColor(np.ascontiguousarray(pixels[:, :, :3]), cv2.COLOR_RGB2GRAY)


def header_of(source: bytes | BinaryIO) -> Image.Image:
    """Return an image of a format that Pillow reads, of which only the header has been read."""
    from PIL import Image, UnidentifiedImageError

    if source == b"":
        raise ValueError("the file is empty")
    file = io.BytesIO(source) if isinstance(source, bytes) else source
    try:
        with warnings.catch_warnings(action="ignore"):  # of large images: `check_claim` decides
            return Image.open(file, formats=_FORMATS)
    except UnidentifiedImageError:
        raise ValueError("damaged, or none of PNG, JPEG, TIFF, BMP, PGM, WebP") from None


def _decode(content: bytes) -> NDArray:
    image = header_of(content)
    # no sample of these formats has more than two bytes
    check_claim(2 * image.width * image.height * len(image.getbands()), len(content))
    mode = _MODES.get(image.mode, "RGB")
    with errors_of_libraries("damaged or truncated"):
        if image.format == "PNG":  # Pillow reduces colours of 16 bits to 8
            import imagecodecs

            return imagecodecs.png_decode(content)
        pixels = np.array(image if image.mode == mode else image.convert(mode))
    return pixels.astype(np.uint16) if mode == "I" else pixels


_VIEWS = {
    2: "mirrored left to right",
    3: "turned by 180 degrees",
    4: "mirrored top to bottom",
    5: "with rows and columns exchanged",
    6: "turned by 90 degrees to the right",
    7: "with rows and columns exchanged and turned by 180 degrees",
    8: "turned by 90 degrees to the left",
}
_LOSSY = ("JPEG", "WEBP")


def image_notes(images: Mapping[str, Iterable[str | os.PathLike]]) -> list[str]:
    """Return a line on each thing that files, by camera, say and that reading them does not heed.

    Only headers are read; files that cannot be read are left to the reader of pixels.
    """
    return grouped_notes(
        (camera, _said_by(path)) for camera, paths in images.items() for path in paths
    )


def grouped_notes(said: Iterable[tuple[str, Iterable[str]]]) -> list[str]:
    """Return one line for each different text, with the cameras whose files it is about."""
    found: dict[str, Counter[str]] = {}
    files: Counter[str] = Counter()
    for camera, texts in said:
        files[camera] += 1
        for text in texts:
            found.setdefault(text, Counter())[camera] += 1
    return [f"{_who(cameras, files)}: {text}" for text, cameras in found.items()]


def lossy_note(what: str) -> str:
    """Return the line on a format whose numbers are no measure of light."""
    return (
        f"{what} has 8 bits, is lossy, and is usually gamma-encoded: its numbers are not "
        "proportional to light, as a reconstruction takes them to be. Record TIFF or PNG"
    )


def _said_by(path: str | os.PathLike) -> list[str]:
    """Return what is to say of one file."""
    said: list[str] = []
    with contextlib.suppress(Exception), open(path, "rb") as file:
        is_tiff = file.read(2) in TIFF_MARKS
        file.seek(0)
        orientation = 1
        kind: str | None = "TIFF"
        if is_tiff:
            with opened_tiff(file) as opened:
                page = image_page(opened)
                orientation = page.tags.valueof("Orientation", 1)
                others = [
                    opened.pages.first,
                    cast("tifffile.TiffPage", opened.pages.get(1, default=page)),
                ]
                if any(one.shape != page.shape and not one.subfiletype for one in others):
                    said.append(
                        f"the page of {page.imagewidth} x {page.imagelength} pixels is the image; "
                        "smaller ones beside it are taken for thumbnails"
                    )
        else:
            import PIL.ExifTags
            import PIL.Image

            header = header_of(file)
            # the general method: PNG's own decodes the image first, however large it claims to be
            exif = PIL.Image.Image.getexif(header)
            orientation, kind = exif.get(PIL.ExifTags.Base.Orientation, 1), header.format
        if orientation in _VIEWS:
            said.append(
                f"an orientation tag ({orientation}) asks for images to be viewed "
                f"{_VIEWS[orientation]}; they are used as stored, row 0 first. A rig calibrated "
                "from turned images, as OpenCV's imread returns them, does not fit: calibrate "
                "with calibrate-rig"
            )
        if kind in _LOSSY:
            said.append(lossy_note(kind))
    return said


def _who(cameras: Counter[str], files: Counter[str]) -> str:
    """Return the cameras' names, and how many of their files are meant where not all are."""
    names = list(cameras)
    total = sum(files[name] for name in names)
    part = f" ({cameras.total()} of {total} images)" if cameras.total() < total else ""
    return f"camera{'s' if len(names) > 1 else ''} {some(names)}{part}"


TIFF_SUFFIXES = (".tif", ".tiff")


def write_image(path: str | os.PathLike, image: ArrayLike) -> None:
    """Write a grey image, whole or not at all.

    Parameters
    ----------
    path : path-like
        ``.tif`` or ``.tiff`` for any ``image``; ``.png`` for integers.
    image : (rows, columns) array
        Floating-point numbers are stored as float32; uint8 and uint16 as they are.

    Raises
    ------
    ValueError
        If the array is no grey image or the format cannot hold it.
    """
    path = Path(path)
    image = np.asarray(image)
    if image.ndim != 2 or 0 in image.shape:
        raise ValueError(f"{path}: found image shape {image.shape}, expected (rows, columns)")
    if image.dtype.kind == "f":
        image = image.astype(np.float32, copy=False)
    elif image.dtype not in (np.uint8, np.uint16):
        raise ValueError(f"{path}: found {image.dtype} pixels, expected float, uint8 or uint16")
    suffix = path.suffix.lower()
    if suffix in TIFF_SUFFIXES:
        import tifffile

        with atomic_path(path) as temporary:
            tifffile.imwrite(temporary, image, photometric="minisblack", metadata=None)
    elif suffix == ".png" and image.dtype.kind == "u":
        import cv2

        encoded = cv2.imencode(".png", image)[1]
        with atomic_path(path) as temporary:
            temporary.write_bytes(encoded.tobytes())
    else:
        raise ValueError(
            f"{path}: found {image.dtype} pixels and suffix {suffix!r}, "
            "expected .tif, or .png for integers"
        )
