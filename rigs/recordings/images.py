"""Grey images as float32, linear in the numbers stored, from files and from memory."""

from __future__ import annotations

import os
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from rigs.files.size_guard import errors_of_libraries
from rigs.files.text import check_plain_file
from rigs.recordings.still import Still
from rigs.recordings.stills import IMAGE_SUFFIXES, read_still
from rigs.recordings.tiff import TIFF_MARKS, opened_tiff, tiff_page

if TYPE_CHECKING:
    from rigs.recordings.recording import Recording

_MOST_CHANNELS = 64
"""Pages of a still that are read as its channels: cameras of many bands have some tens. Following
a long chain of pages takes long."""


def read_image(
    path: str | os.PathLike,
    bit_depth: int | None = None,
    usable: NDArray[np.bool_] | None = None,
    *,
    channel: str | None = None,
    bayer: str | None = None,
    must_have_channel: bool = True,
) -> NDArray[np.float32]:
    """Read a grey image, or a colour of an image in colour.

    Floating-point numbers stay as they are. Integers are divided by their full scale, so that
    full scale is 1: by the largest number of the bits that the file says were recorded, 4095 for
    12 bits packed or in a PGM, else by that of their type, 65535 for 16 bits.

    Parameters
    ----------
    path : path-like
        A file that ends in one of `IMAGE_SUFFIXES`.
    bit_depth : int, optional
        Bits the camera really uses where the file does not say: 12 bits stored in 16 are divided
        by 4095.
    usable : (rows, columns) bool, optional
        False where the pixel does not count: there, and only there, NaN and infinity are allowed
        and become 0.
    channel : {"r", "g", "b"}, or "0", "1" ..., optional
        The colour to take of an image in colour. Colours that are equal everywhere need none. A
        number is that of one of several channels, from 0, which TIFF may have as pages.
    bayer : str, optional
        Colours of the filters over 2 x 2 pixels. All pixels are returned, see `Mosaic`; a file
        that says that it is a mosaic is refused without.
    must_have_channel : bool
        Whether a grey image is refused where a channel is chosen: it may be a mosaic. Masks need
        no colours.

    Returns
    -------
    image : (rows, columns) float32
        Row 0 of the file first, whatever the file says about the way it is viewed.

    Raises
    ------
    ValueError
        If the file is no grey image, is truncated, or holds NaN or infinity in a usable pixel.
    FileNotFoundError
        If there is no such file.
    """
    image, _ = read_with_full_scale(
        path, bit_depth, usable, channel=channel, bayer=bayer, must_have_channel=must_have_channel
    )
    return image


def read_with_full_scale(
    path: str | os.PathLike,
    bit_depth: int | None = None,
    usable: NDArray[np.bool_] | None = None,
    *,
    channel: str | None = None,
    bayer: str | None = None,
    must_have_channel: bool = True,
) -> tuple[NDArray[np.float32], int]:
    """Return what `read_image` does, and the full scale that integers were divided by, or 1."""
    path = Path(path)
    if path.is_dir():
        raise ValueError(f"{path}: found a folder, expected one image, such as dark frames' mean")
    if path.suffix.lower() not in IMAGE_SUFFIXES:
        expected = ", ".join(IMAGE_SUFFIXES)
        raise ValueError(f"{path}: found suffix {path.suffix!r}, expected one of {expected}")
    check_plain_file(path)
    if not path.is_file():
        raise FileNotFoundError(f"{path}: no such image file")
    still, channel = _still(path, channel)
    check_pattern(path, still.is_mosaic, bayer)
    if still.is_grey and channel is not None and bayer is None and must_have_channel:
        raise ValueError(
            f"{path}: found a grey image, expected colours to take channel {channel} of: a mosaic "
            "of colour filters needs the order of its colours too, like bayer='RGGB'; others no "
            "channel"
        )
    try:
        return _intensities(still, None if bayer else channel, bit_depth, usable)
    except ValueError as error:
        raise ValueError(f"{path}: {error}") from None


def check_pattern(source: object, is_mosaic: bool, bayer: str | None) -> None:
    """Raise where a mosaic of colour filters is to be read without the order of its colours."""
    if is_mosaic and bayer is None:
        raise ValueError(
            f"{source}: found a mosaic of colour filters, expected the order of its colours and "
            "the colour to reconstruct: bayer='RGGB', channel='g', or corrections: {bayer: RGGB, "
            "channel: g} in scan.yaml"
        )


def intensities_with_full_scale(
    stored: NDArray,
    source: object,
    bit_depth: int | None = None,
    usable: NDArray[np.bool_] | None = None,
) -> tuple[NDArray[np.float32], int]:
    """Return stored pixels as intensities, and the full scale that integers were divided by, or 1.

    ``source`` is what errors name; for the others see `read_image`.
    """
    try:
        return _intensities(Still.of(stored), None, bit_depth, usable)
    except ValueError as error:
        raise ValueError(f"{source}: {error}") from None


def is_integer_image(path: str | os.PathLike) -> bool:
    """Return whether an image file holds integers, which `read_image` scales to 0..1."""
    check_plain_file(path)
    with open(path, "rb") as file:
        if file.read(2) not in TIFF_MARKS:
            return True
    if (film := _of_channels(Path(path))) is not None:
        return film.bit_depth is not None
    with errors_of_libraries(f"{path}: not a readable image"), tiff_page(path) as page:
        return np.dtype(page.dtype).kind in "biu"


def _still(path: Path, channel: str | None) -> tuple[Still, str | None]:
    """Return an image, and which of its channels is still to be taken."""
    try:
        return read_still(path), channel
    except ValueError:
        film = _of_channels(path)
        if film is None:
            raise
    return Still.of(film.read_channel(0, channel), film.bit_depth), None


def _of_channels(path: Path) -> Recording | None:
    """Return a TIFF file whose pages are the channels of one moment; None for any other file."""
    from rigs.recordings.films import is_film, open_recording  # they read images too

    with suppress(Exception):  # said by the reader of stills
        with opened_tiff(path) as file:
            if file.pages.get(_MOST_CHANNELS, default=file.pages.first) is not file.pages.first:
                return None
        film = open_recording(path) if is_film(path) else None
        if film is not None and film.n_frames == 1 < len(film.channels):
            return film
    return None


def _intensities(
    still: Still, channel: str | None, bit_depth: int | None, usable: NDArray[np.bool_] | None
) -> tuple[NDArray[np.float32], int]:
    stored = still.grey(channel)
    if still.full_scale is not None:
        return _scaled(stored, still.full_scale, bit_depth)
    with np.errstate(over="ignore"):  # a larger number becomes infinity, which is refused
        image = stored.astype(np.float32)
    bad = np.isfinite(image)
    np.logical_not(bad, out=bad)
    if usable is not None and usable.shape == image.shape:
        image[bad & ~usable] = 0
        bad &= usable
    if bad.any():
        row, column = np.argwhere(bad)[0].tolist()
        raise ValueError(
            f"found {bad.sum()} NaN or infinite pixels, the first at row {row}, "
            f"column {column}, expected finite single-precision values or a mask over them"
        )
    return image, 1


def _scaled(
    stored: NDArray, full_scale: int, bit_depth: int | None
) -> tuple[NDArray[np.float32], int]:
    """Return integers over their full scale; negative ones, of differences, stay negative."""
    stored_bits = 8 * stored.dtype.itemsize
    if bit_depth is not None:
        if not 1 <= bit_depth <= stored_bits:
            raise ValueError(f"bit_depth: found {bit_depth}, expected 1 to {stored_bits}")
        full_scale = min(2**bit_depth - 1, int(np.iinfo(stored.dtype).max))  # signed: half
    if stored.max(initial=0) > full_scale:
        raise ValueError(
            f"found a pixel of {stored.max()}, expected at most {full_scale}"
            + (f" with bit_depth {bit_depth}" if bit_depth is not None else "")
        )
    exact = np.float64 if stored_bits > 16 else np.float32  # numbers that float32 would round
    image: NDArray = stored.astype(exact)
    image /= exact(full_scale)
    return image.astype(np.float32, copy=False), full_scale
