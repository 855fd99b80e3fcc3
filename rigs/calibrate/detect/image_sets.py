"""Images of a target in folders or films, by camera and frame, and their reading."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from rigs.files.text import some
from rigs.recordings import (
    CONTAINER_SUFFIXES,
    FILM_SUFFIXES,
    IMAGE_SUFFIXES,
    find_images,
    image_notes,
    is_film,
    luminance,
    open_recording,
    read_still,
    without_pattern,
)
from rigs.recordings.layout import ONLY, Images, how_to_name, images_in, natural
from rigs.recordings.stills import grouped_notes

_NEVER_IMAGES = (
    ".csv", ".html", ".ini", ".json", ".log", ".m", ".mat", ".md", ".npz", ".odt", ".ods", ".pdf",
    ".py", ".pyc", ".toml", ".txt", ".xls", ".xlsx", ".xml", ".yaml", ".yml", ".zip",
)  # fmt: skip
_LENSES, _POSES = "intri", "extri"  # folders' names, as Pose2Sim has them
_BY_PATTERN = "; cameras are called alike by --pattern, like '*_{camera}_img/{frame}.*'"


@dataclass(frozen=True)
class VideoFrame:
    """One picture of a video: the file's path, and the picture's number from 0."""

    path: Path
    index: int

    def __str__(self) -> str:
        return f"{self.path}: frame {self.index}"


@dataclass(frozen=True)
class MosaicImage:
    """An image file of a sensor with colour filters, even where the file does not say so."""

    path: Path

    def __str__(self) -> str:
        return str(self.path)


Source = str | os.PathLike | VideoFrame | MosaicImage | np.ndarray
"""Where an image comes from: a file, a picture of a video, or the image itself."""


def image_set(
    folder: str | os.PathLike,
    every: int = 1,
    note: Callable[[str], None] | None = None,
    *,
    pattern: str | None = None,
    are_mosaics: bool = False,
) -> dict[str, dict[str, Source]]:
    """Return the images in ``folder``, by camera and frame.

    Parameters
    ----------
    folder : path-like
        Folders named as the cameras, in which equal file names without suffix are one frame;
        images ``CAMERA_NUMBER.*`` beside each other; or films, see `rigs.recordings.films`,
        named as the cameras, in which equal picture numbers are one frame. Names that begin with
        a dot and files of other kinds are ignored.
    every : int
        Use every n-th picture of a film.
    note : callable, optional
        Called with a line on each folder that holds only files that are never images, like
        texts; it is not taken as a camera.
    pattern : str, optional
        How files are named otherwise, see `rigs.recordings.find_images`.
    are_mosaics : bool
        Whether images are mosaics of colour filters: the pattern is smoothed away.

    Returns
    -------
    images : dict of camera to dict of frame to source
        In natural order: ``cam2`` before ``cam10``.

    Raises
    ------
    ValueError
        If there is nothing to read, folders and films are mixed, a camera's folder is empty or
        has one frame twice, or a film cannot be decoded.
    """
    folder = Path(folder)
    if not folder.is_dir():
        raise ValueError(f"{folder}: found no folder, expected one folder or one video per camera")
    if every < 1:
        raise ValueError(f"every: found {every}, expected at least 1")
    if pattern is not None:
        found = find_images(folder, None, pattern)
        if not found:
            raise ValueError(
                f"{folder}: pattern: found no image whose name fits {pattern!r}, expected some"
            )
        alone = {camera: each[ONLY] for camera, each in found.items() if ONLY in each}
        if len(alone) == len(found) and all(is_film(path) for path in alone.values()):
            return _pictures_of(alone, every, are_mosaics)
        return _sources(found, are_mosaics)
    check_not_split(folder, are_lenses_given=True)
    inside = [path for path in folder.iterdir() if not path.name.startswith(".")]
    inside.sort(key=lambda path: natural(path.name))
    folders = [path for path in inside if path.is_dir() and not is_film(path)]
    files = [path for path in inside if path not in folders]
    loose = [path for path in files if path.suffix.lower() in IMAGE_SUFFIXES]
    films = [path for path in files if path.suffix.lower() in FILM_SUFFIXES or path.is_dir()]
    if not films and not folders:
        arrays = [path for path in files if path.suffix.lower() in CONTAINER_SUFFIXES]
        films = [path for path in loose if is_film(path)] or arrays
        still = next((path for path in loose if path not in films), None)
        if films and still:
            raise ValueError(
                f"{folder}: found {films[0].name} of many pages and {still.name} of one image, "
                "expected one film or one folder of images per camera"
            )
    if folders and films:
        raise ValueError(
            f"{folder}: found the folder {folders[0].name} and the video {films[0].name}, "
            "expected one folder per camera or one video per camera"
        )
    if films:
        named = {path.stem: path for path in films}
        if len(named) < len(films):
            twice = next(path for path in films if named[path.stem] != path)
            raise ValueError(f"{folder}: camera {twice.stem}: found two videos, expected one")
        return _pictures_of(named, every, are_mosaics)
    for path in folders:
        if _is_stray(path):
            if note is not None:
                note(f"{path}: holds no image, only files of other kinds: not taken as a camera")
        elif not images_in(path):
            raise ValueError(
                f"{path}: camera {path.name}: found no images ({_contents(path)}), expected some "
                f"of {', '.join(IMAGE_SUFFIXES)}; move the folder away if it is no camera, or say "
                "where images are, like --pattern '{camera}/{frame}.tif'"
            )
    found = find_images(folder)
    if not found:
        there = f"{len(loose)} images outside camera folders" if loose else "neither"
        raise ValueError(
            f"{folder}: found {there}, expected one folder or one video per camera, or "
            f"{how_to_name(loose, folder, None)}"
        )
    return _sources(found, are_mosaics)


def check_not_split(folder: Path, are_lenses_given: bool = False) -> None:
    """Raise where a folder holds, or is one of, two folders of images for lenses and for poses.

    As one set they fail after minutes: equal names are no moment. With lenses poses alone are
    right.
    """
    if not folder.is_dir():
        return
    lenses, poses = _named(folder, _LENSES), _named(folder, _POSES)
    is_one = folder.name.lower().startswith((_LENSES, _POSES)) and not are_lenses_given
    if is_one and not (lenses and poses):
        lenses, poses = (_named(folder.absolute().parent, name) for name in (_LENSES, _POSES))
    if lenses is None or poses is None:
        return
    cameras = [{path.name for path in one.iterdir() if path.is_dir()} for one in (lenses, poses)]
    alike = "" if cameras[0] == cameras[1] else _BY_PATTERN
    raise ValueError(
        f"{folder}: found images of lenses in {lenses.name} and of poses in {poses.name}, "
        f"expected each as what it is: {poses} as IMAGES and --intrinsics-images {lenses}{alike}"
    )


def _named(folder: Path, start: str) -> Path | None:
    """Return the folder in ``folder`` whose name begins so, if it is one alone."""
    found = [p for p in folder.iterdir() if p.name.lower().startswith(start) and p.is_dir()]
    return found[0] if len(found) == 1 else None


def _sources(found: Images, are_mosaics: bool) -> dict[str, dict[str, Source]]:
    """Return the sources of image files."""
    return {
        camera: {frame: MosaicImage(path) if are_mosaics else path for frame, path in each.items()}
        for camera, each in found.items()
    }


def notes_of(images: Mapping[str, Mapping[str, Source]]) -> list[str]:
    """Return lines on what files say and reading does not heed, see `image_notes`."""
    stills = {
        camera: [
            Path(str(one))
            for one in frames.values()
            if isinstance(one, str | os.PathLike | MosaicImage)
        ]
        for camera, frames in images.items()
    }
    films = {
        (camera, source.path)
        for camera, frames in images.items()
        for source in frames.values()
        if isinstance(source, VideoFrame)
    }
    of_films = ((camera, open_recording(path).notes) for camera, path in sorted(films))
    return [*image_notes(stills), *grouped_notes(of_films)]


def read_source(source: Source) -> NDArray:
    """Return the grey image ``(rows, columns)`` of a source, in the numbers stored, not turned.

    Colour becomes its luminance; an array's channels are blue, green and red, as OpenCV has them.
    """
    if isinstance(source, VideoFrame):
        return next(iter(read_pictures(source.path, [source.index])))[1]
    if isinstance(source, np.ndarray):
        return _grey(source, "image", blue_first=True)
    path = source.path if isinstance(source, MosaicImage) else Path(source)
    try:
        still = read_still(path)
    except OSError as error:
        raise ValueError(f"{path}: cannot be read: {error.strerror}") from None
    image = still.pixels
    if still.is_grey and (still.is_mosaic or isinstance(source, MosaicImage)):
        image = without_pattern(image)
    return _grey(image, str(path))


def read_pictures(path: Path, indices: Iterable[int]) -> Iterator[tuple[int, NDArray]]:
    """Yield number and grey image of a film's pictures, in order; it must have all of them."""
    film = open_recording(path)
    for index in sorted(set(indices)):
        image = film.read(index)
        image = without_pattern(image) if film.is_mosaic else image
        yield index, _grey(image, f"{path}: picture {index}")


def _pictures_of(
    films: Mapping[str, Path], every: int, are_mosaics: bool
) -> dict[str, dict[str, Source]]:
    """Return every n-th picture of each camera's film."""
    if are_mosaics:
        path = next(iter(films.values()))
        raise ValueError(f"{path}: bayer: found a film, expected image files")
    return {
        camera: {
            f"{index:06d}": VideoFrame(path, index)
            for index in range(0, open_recording(path).n_frames, every)
        }
        for camera, path in films.items()
    }


def _is_stray(folder: Path) -> bool:
    """Return whether a folder has files, all of kinds that are never images."""
    inside = [path for path in folder.iterdir() if not path.name.startswith(".")]
    return bool(inside) and all(
        path.is_file() and path.suffix.lower() in _NEVER_IMAGES for path in inside
    )


def _contents(folder: Path) -> str:
    """Return what a folder without images holds, in words."""
    inside = [path for path in folder.iterdir() if not path.name.startswith(".")]
    kinds = {path.suffix.lower() or path.name for path in inside if path.is_file()}
    kinds |= {f"folder {path.name}" for path in inside if path.is_dir()}
    return some(sorted(kinds)) or "it is empty"


def _grey(image: NDArray, name: str, blue_first: bool = False) -> NDArray:
    """Return a colour image's luminance, a grey image as it is; only files have grey and alpha."""
    channels = image.shape[2] if image.ndim == 3 else 1
    if (
        image.ndim not in (2, 3)
        or channels not in ((1, 3, 4) if blue_first else (1, 2, 3, 4))
        or min(image.shape[:2]) < 2
        or image.dtype.kind not in "uif"
    ):
        raise ValueError(
            f"{name}: found shape {image.shape} of {image.dtype}, expected an image in grey or "
            "colour"
        )
    image = luminance(image[:, :, 2::-1] if blue_first and channels > 2 else image)
    if image.dtype.kind == "f" and not np.isfinite(image).all():
        raise ValueError(f"{name}: found NaN or infinite pixels, expected finite ones")
    return image
