"""Grey images in and out: TIFF, PNG and JPEG as float32, linear in the numbers stored."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rigs.files import atomic_path
from rigs.files.size_guard import errors_of_libraries
from rigs.recordings.pixels import read_pixels
from rigs.recordings.tiff import TIFF_MARKS, tiff_page

TIFF_SUFFIXES = (".tif", ".tiff")
SCAN_SUFFIXES = (*TIFF_SUFFIXES, ".png", ".jpg", ".jpeg")


def read_image(
    path: str | os.PathLike,
    bit_depth: int | None = None,
    usable: NDArray[np.bool_] | None = None,
) -> NDArray[np.float32]:
    """Read a grey image.

    Floating-point numbers stay as they are. Integers are divided by their full scale, 255 for
    8-bit and 65535 for 16-bit storage, so that full scale is 1.

    Parameters
    ----------
    path : path-like
        ``.tif``, ``.tiff``, ``.png``, ``.jpg`` or ``.jpeg``.
    bit_depth : int, optional
        Bits the camera really uses: 12 bits stored in 16 are divided by 4095.
    usable : (rows, columns) bool, optional
        False where the pixel does not count: there, and only there, NaN and infinity are allowed
        and become 0.

    Returns
    -------
    image : (rows, columns) float32

    Raises
    ------
    ValueError
        If the file is no grey image, is truncated, or holds NaN or infinity in a usable pixel.
    FileNotFoundError
        If there is no such file.

    Notes
    -----
    JPEG has no check sum: data damaged inside are decoded as they are. TIFF and PNG are the
    formats for measurements.
    """
    path = Path(path)
    if path.suffix.lower() not in SCAN_SUFFIXES:
        expected = ", ".join(SCAN_SUFFIXES)
        raise ValueError(f"{path}: found suffix {path.suffix!r}, expected one of {expected}")
    if not path.is_file():
        raise FileNotFoundError(f"{path}: no such image file")
    stored = read_pixels(path)
    if stored.ndim != 2:
        raise ValueError(
            f"{path}: found a colour image of shape {stored.shape}, "
            f"{min(stored.shape)} channels, expected a grey one (rows, columns)"
        )
    return intensities(stored, path, bit_depth, usable)


def intensities(
    stored: NDArray,
    source: object,
    bit_depth: int | None = None,
    usable: NDArray[np.bool_] | None = None,
) -> NDArray[np.float32]:
    """Return stored pixels as intensities ``(rows, columns)``, see `read_image`.

    ``source`` is what errors name: the file, or the place of an image in memory.

    Raises
    ------
    ValueError
        If a usable pixel is NaN or infinite, or the pixels are not of a known type.
    """
    image = _to_float(source, stored, bit_depth)
    if stored.dtype.kind != "f":
        return image
    bad = np.isfinite(image)
    np.logical_not(bad, out=bad)
    if usable is not None and usable.shape == image.shape:
        image[bad & ~usable] = 0
        bad &= usable
    if bad.any():
        row, column = np.argwhere(bad)[0].tolist()
        raise ValueError(
            f"{source}: found {bad.sum()} NaN or infinite pixels, the first at row {row}, "
            f"column {column}, expected finite single-precision values or a mask over them"
        )
    return image


def is_integer_image(path: str | os.PathLike) -> bool:
    """Return whether an image file holds integers, which `read_image` scales to 0..1.

    Raises
    ------
    ValueError
        If it is a TIFF that cannot be read. Other formats for scans hold nothing but integers.
    """
    with open(path, "rb") as file:
        if file.read(2) not in TIFF_MARKS:
            return True
        file.seek(0)
        with errors_of_libraries(f"{path}: not a readable image"), tiff_page(file) as page:
            return page.dtype.kind in "biu"


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


def _to_float(path: Path, stored: NDArray, bit_depth: int | None) -> NDArray[np.float32]:
    if stored.dtype.kind == "f":
        with np.errstate(over="ignore"):  # a larger number becomes infinity, which is refused
            return stored.astype(np.float32)
    if stored.dtype not in (np.uint8, np.uint16):
        raise ValueError(
            f"{path}: found {stored.dtype} pixels, expected uint8, uint16 or floating point"
        )
    stored_bits = 8 * stored.dtype.itemsize
    bits = stored_bits if bit_depth is None else bit_depth
    if not 1 <= bits <= stored_bits:
        raise ValueError(f"{path}: bit_depth: found {bit_depth}, expected 1 to {stored_bits}")
    full_scale = 2**bits - 1
    if stored.max(initial=0) > full_scale:
        raise ValueError(
            f"{path}: found a pixel of {stored.max()}, "
            f"expected at most {full_scale} with bit_depth {bits}"
        )
    image = stored.astype(np.float32)
    image /= np.float32(full_scale)
    return image
