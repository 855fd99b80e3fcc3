"""One image of a scan, in a file, in a film or in memory; frames, and means of several images."""

from __future__ import annotations

import glob
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from fnmatch import fnmatchcase
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rigs.recordings import find_images
from rigs.recordings.layout import images_in
from tomo.scan.films import FilmFrame, Frame, ImageSource, films_in


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

    ``bit_depth`` is that which the camera really uses; ``colours`` are ``channel`` and ``bayer``,
    see `tomo.scan.Corrections`; pixels that are ``usable`` ``(height, width)`` must be finite. A
    correction's image may be grey where images are in colour, and no frame is lost with it.
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


def find_frame(frames: Sequence[Frame], name: str) -> Frame | None:
    """Return the one frame of a name, of a number at its end, or of another end.

    None where the first of these that fits any frame fits more than one, or nothing fits.
    """
    ways = (
        lambda frame: frame.name == name,
        lambda frame: _last_number(frame.name) == _last_number(name) and name.isdecimal(),
        lambda frame: name != "" and frame.name.endswith(name),
    )
    for is_meant in ways:
        found = [frame for frame in frames if is_meant(frame)]
        if found:
            return found[0] if len(found) == 1 else None
    return None


def _last_number(name: str) -> int | None:
    """Return the number that a name ends with; None where it ends otherwise."""
    digits = re.search(r"[0-9]+$", name)
    return int(digits[0]) if digits else None


CAMERA = "{camera}"
"""Stands for a camera's name in the path of a correction's image."""


@dataclass(frozen=True)
class MeanImage:
    """The mean of several images of one camera, such as dark frames, read when first asked for."""

    images: tuple[Path | FilmFrame, ...]
    _known: dict[Any, NDArray[np.float32]] = field(
        default_factory=dict, init=False, repr=False, compare=False
    )

    def read(
        self, camera: str, size: tuple[int, int], bits: int | None, colours: Mapping[str, Any]
    ) -> NDArray[np.float32]:
        """Return the mean ``(height, width)``; parameters as of `read_intensities`."""
        key = (bits, *colours.values())
        if key not in self._known:
            total = np.zeros(size[::-1])
            for image in self.images:
                total += read_intensities(
                    image, camera, size, bits, colours, is_correction=True
                )[0]  # fmt: skip
            self._known[key] = (total / len(self.images)).astype(np.float32)
        return self._known[key]


def images_by_camera(name: str, value: Any, cameras: Sequence[str]) -> Any:
    """Return a correction's value with one image, or the mean of several, for each camera.

    A folder stands for its images: those of each camera, by the names of `find_images`, or all
    where it is one camera's. ``{camera}`` in a path stands for the camera's name, ``*`` in a
    file's name for any text. Other values stay. A mask is one image.
    """
    if isinstance(value, Path) and CAMERA in str(value):
        value = {camera: Path(str(value).replace(CAMERA, camera)) for camera in cameras}
    if isinstance(value, Mapping):
        return {
            camera: _one(name, camera, tuple(_images_of(one)), one)
            if isinstance(one, Path) and (one.is_dir() or "*" in one.name)
            else one
            for camera, one in value.items()
        }
    if not (isinstance(value, Path) and value.is_dir()):
        return value
    found = dict(_in_folder(value, cameras))
    missing = [camera for camera in cameras if camera not in found]
    if missing and (name != "mask" or not found):
        raise _no_image(name, missing[0], value, f"{missing[0]}.tif or {missing[0]}/*.tif in it")
    return {camera: _one(name, camera, images, value) for camera, images in found.items()}


def _images_of(place: Path) -> list[Path]:
    """Return the images in a folder, or those whose names a pattern with ``*`` fits."""
    if place.is_dir():
        return images_in(place)
    fits = glob.escape(place.name).replace("[*]", "*")
    return [path for path in images_in(place.parent) if fnmatchcase(path.name, fits)]


def _in_folder(
    folder: Path, cameras: Sequence[str]
) -> Iterator[tuple[str, tuple[Path | FilmFrame, ...]]]:
    """Yield the images of each camera in a folder, those of films one by one."""
    films = films_in(folder, tuple(cameras))
    for camera, film in films.items():
        yield camera, tuple(FilmFrame(film, place) for place in range(film.n_frames))
    if not films:
        for camera, images in find_images(folder, cameras).items():
            yield camera, tuple(images.values())


def _one(
    name: str, camera: str, images: tuple[Path | FilmFrame, ...], folder: Path
) -> Path | FilmFrame | MeanImage:
    """Return a camera's only image, or the mean of several."""
    if not images:
        raise _no_image(name, camera, folder, "images in it")
    if name == "mask" and len(images) > 1:
        raise ValueError(
            f"corrections.{name}: camera {camera}: found {len(images)} images in {folder}, "
            "expected one"
        )
    return images[0] if len(images) == 1 and isinstance(images[0], Path) else MeanImage(images)


def _no_image(name: str, camera: str, folder: Path, expected: str) -> ValueError:
    return ValueError(
        f"corrections.{name}: camera {camera}: found no image of it in {folder}, expected "
        f"{expected}"
    )
