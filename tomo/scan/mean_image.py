"""Images of corrections by camera: those of a folder or a pattern, and the mean of several."""

from __future__ import annotations

import glob
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from fnmatch import fnmatchcase
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rigs.recordings import find_images
from rigs.recordings.layout import images_in
from tomo.scan.films import FilmFrame, films_in
from tomo.scan.image_source import read_intensities

CAMERA = "{camera}"
"""Stands for a camera's name in the path of a correction's image."""


@dataclass(frozen=True)
class MeanImage:
    """The mean of several images of one camera, such as dark frames, read when first asked for.

    Attributes
    ----------
    images : tuple of Path or FilmFrame
    """

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

    Parameters
    ----------
    name : str
        The correction: errors name it, and a mask is one image.
    value : object
        One for all cameras, or a mapping from camera. The path of a folder stands for its images:
        those of each camera, by the names of `find_images`, or all where it is one camera's.
        ``{camera}`` in a path stands for the camera's name, and ``*`` in a file's name for any
        text. Other values are returned as they are.
    cameras : sequence of str

    Raises
    ------
    ValueError
        If a camera has no image in a folder (a mask may be missing), or several masks.
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
