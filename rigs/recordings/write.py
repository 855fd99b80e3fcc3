"""Grey images onto disk: TIFF for any numbers, PNG for integers."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike

from rigs.files import atomic_path

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
