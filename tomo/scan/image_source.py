"""One image of a scan, wherever it is: in a file, in a film, or in memory."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tomo.scan.films import FilmFrame

ImageSource = Path | NDArray | FilmFrame


def read_intensities(
    image: ImageSource,
    camera: str,
    size: tuple[int, int],
    bit_depth: int | None,
    colours: Mapping[str, Any],
    usable: NDArray[np.bool_] | None = None,
    is_correction: bool = False,
) -> tuple[NDArray[np.float32], int]:
    """Return a camera's image, integers divided by their full scale, and that scale in counts.

    Parameters
    ----------
    image : Path, FilmFrame or (height, width) array
    camera : str
        Errors name it.
    size : (width, height)
        That of the camera's images.
    bit_depth : int, optional
        Bits that the camera really uses of an integer image.
    colours : mapping
        ``channel`` and ``bayer`` of the camera, see `tomo.scan.Corrections`.
    usable : (height, width) bool, optional
        Where pixels must be finite.
    is_correction : bool
        Whether the image is a correction's: it may be grey where images are in colour, and no
        frame is lost with it.

    Raises
    ------
    FrameError
        If a frame's image in a file is unreadable, not grey, or not finite where it is usable.
    ValueError
        If it is of another size, or that is so of a correction or of an array.
    FileNotFoundError
        If it is missing.
    """
    from rigs.recordings import (
        FrameError,
        check_pattern,
        intensities_with_full_scale,
        read_with_full_scale,
    )

    place = "" if isinstance(image, np.ndarray) else f"{image}: "
    try:
        if isinstance(image, Path):
            values, full_scale = read_with_full_scale(
                image, bit_depth, usable, **colours, must_have_channel=not is_correction
            )
        elif isinstance(image, FilmFrame):
            film = image.film.recording
            check_pattern(image, film.is_mosaic, colours["bayer"])
            channel = None if colours["bayer"] else colours["channel"]
            values, full_scale = intensities_with_full_scale(
                image.read(channel), image, bit_depth or film.bit_depth, usable
            )
        else:
            values, full_scale = intensities_with_full_scale(
                image, "image in memory", bit_depth, usable
            )
    except FileNotFoundError as error:
        raise FileNotFoundError(f"camera {camera}: {error}") from error
    except ValueError as error:
        said = f"camera {camera}: {str(error).removeprefix(f'{image}: ')}"
        if is_correction or isinstance(image, np.ndarray):
            raise ValueError(f"{place}{said}") from error
        if isinstance(image, Path):
            raise FrameError(image, None, said) from error
        raise FrameError(image.film.path, image.place, said) from error
    if values.shape[::-1] != tuple(size):
        raise ValueError(
            f"{place}camera {camera}: found an image of {values.shape[1]} x {values.shape[0]} "
            f"pixels, expected {size[0]} x {size[1]}, the camera's image_size"
        )
    return values, full_scale


def holds_integers(image: ImageSource) -> bool:
    """Tell whether an image, in a file or in memory, holds integers, which are scaled to 0..1."""
    from rigs.recordings import is_integer_image

    if isinstance(image, FilmFrame):
        return image.film.holds_integers
    return is_integer_image(image) if isinstance(image, Path) else image.dtype.kind in "biu"
