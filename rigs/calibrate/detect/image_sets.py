"""Images of a target in folders or videos, by camera and frame, and their reading."""

from __future__ import annotations

import os
import re
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from rigs.recordings import IMAGE_SUFFIXES, luminance, read_pixels

_NEVER_IMAGES = (
    ".csv", ".html", ".ini", ".json", ".log", ".m", ".mat", ".md", ".npz", ".odt", ".ods", ".pdf",
    ".py", ".pyc", ".toml", ".txt", ".xls", ".xlsx", ".xml", ".yaml", ".yml", ".zip",
)  # fmt: skip
VIDEO_SUFFIXES = (".mp4", ".avi", ".mov", ".mkv", ".m4v", ".webm", ".mpg", ".mpeg", ".wmv")


@dataclass(frozen=True)
class VideoFrame:
    """One picture of a video.

    Parameters
    ----------
    path : pathlib.Path
        The video.
    index : int
        The picture's number, from 0.
    """

    path: Path
    index: int

    def __str__(self) -> str:
        return f"{self.path}: frame {self.index}"


Source = str | os.PathLike | VideoFrame | np.ndarray
"""Where an image comes from: a file, a picture of a video, or the image itself."""


def image_set(
    folder: str | os.PathLike, every: int = 1, note: Callable[[str], None] | None = None
) -> dict[str, dict[str, Source]]:
    """Return the images in ``folder``: one folder per camera, or one video per camera.

    Parameters
    ----------
    folder : path-like
        Either folders named as the cameras, in which equal file names without suffix are one
        frame; or videos named as the cameras, in which equal picture numbers are one frame.
        Names that begin with a dot and files of other kinds are ignored.
    every : int
        Use every n-th picture of a video.
    note : callable, optional
        Called with a line on each folder that holds only files that are never images, like
        texts; it is not taken as a camera.

    Returns
    -------
    images : dict of camera to dict of frame to source
        In natural order: ``cam2`` before ``cam10``.

    Raises
    ------
    ValueError
        If there is nothing to read, folders and videos are mixed, a camera's folder is empty or
        has one frame twice, or a video cannot be decoded.
    """
    folder = Path(folder)
    if not folder.is_dir():
        raise ValueError(f"{folder}: found no folder, expected one folder or one video per camera")
    if every < 1:
        raise ValueError(f"every: found {every}, expected at least 1")
    inside = [path for path in folder.iterdir() if not path.name.startswith(".")]
    inside.sort(key=lambda path: _natural(path.name))
    folders = [path for path in inside if path.is_dir()]
    videos = [path for path in inside if path.suffix.lower() in VIDEO_SUFFIXES and path.is_file()]
    if folders and videos:
        raise ValueError(
            f"{folder}: found the folder {folders[0].name} and the video {videos[0].name}, "
            "expected one folder per camera or one video per camera"
        )
    if not folders and not videos:
        loose = sum(path.suffix.lower() in IMAGE_SUFFIXES for path in inside)
        there = f"{loose} images outside camera folders" if loose else "neither"
        raise ValueError(f"{folder}: found {there}, expected one folder or one video per camera")
    if folders:
        stray = [path for path in folders if _is_stray(path)]
        if len(stray) == len(folders):
            raise ValueError(
                f"{folder}: found no images in {', '.join(path.name for path in folders)}, "
                "expected one folder of images per camera"
            )
        for path in stray if note is not None else ():
            note(f"{path}: holds no image, only files of other kinds: not taken as a camera")
        return {path.name: _images_in(path) for path in folders if path not in stray}
    images: dict[str, dict[str, Source]] = {}
    for path in videos:
        if path.stem in images:
            raise ValueError(f"{folder}: camera {path.stem}: found two videos, expected one")
        images[path.stem] = {
            f"{index:06d}": VideoFrame(path, index)
            for index in range(0, _count_pictures(path), every)
        }
    return images


def read_source(source: Source) -> NDArray:
    """Return the grey image ``(rows, columns)`` of a source, in the numbers stored.

    Colour becomes grey by its luminance; an array's channels are blue, green and red, as OpenCV
    has them. How a file is meant to be turned for viewing is ignored: calibration is about the
    sensor.

    Raises
    ------
    ValueError
        If it cannot be read, is truncated, or is no image; the message names the file.
    """
    if isinstance(source, VideoFrame):
        return next(iter(read_pictures(source.path, [source.index])))[1]
    if isinstance(source, np.ndarray):
        return _grey(source, "image", blue_first=True)
    path = Path(source)
    try:
        image = read_pixels(path)
    except OSError as error:
        raise ValueError(f"{path}: cannot be read: {error.strerror}") from None
    return _grey(image, str(path))


def read_pictures(path: Path, indices: Iterable[int]) -> Iterator[tuple[int, NDArray]]:
    """Yield number and grey image of a video's pictures, in order.

    A video is decoded from its beginning, because seeking is inexact in many formats.

    Raises
    ------
    ValueError
        If the video cannot be opened or ends before the last picture asked for.
    """
    wanted = sorted(set(indices))
    video = _open_video(path)
    try:
        at = 0
        for index in wanted:
            while at <= index:
                if not video.grab():
                    raise ValueError(
                        f"{path}: decoding stops at picture {at}, expected {wanted[-1] + 1}"
                    )
                at += 1
            decoded, image = video.retrieve()
            if not decoded:
                raise ValueError(f"{path}: picture {index} cannot be decoded")
            yield index, _grey(image, f"{path}: picture {index}", blue_first=True)
    finally:
        video.release()


def _images_in(folder: Path) -> dict[str, Source]:
    paths = [
        path
        for path in folder.iterdir()
        if path.is_file()
        and path.suffix.lower() in IMAGE_SUFFIXES
        and not path.name.startswith(".")
    ]
    if not paths:
        raise ValueError(
            f"{folder}: camera {folder.name}: found no images ({_contents(folder)}), expected "
            f"some of {', '.join(IMAGE_SUFFIXES)}; move the folder away if it is no camera"
        )
    images: dict[str, Source] = {}
    for path in sorted(paths, key=lambda path: _natural(path.name)):
        if path.stem in images:
            raise ValueError(
                f"{path}: camera {folder.name}: found the frame {path.stem} twice, "
                f"{Path(images[path.stem]).name} is another, expected one image"
            )
        images[path.stem] = path
    return images


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
    named = sorted(kinds)
    return ", ".join(named[:4]) + (", ..." if len(named) > 4 else "") if named else "it is empty"


def _open_video(path: Path) -> cv2.VideoCapture:
    if not path.is_file():
        raise ValueError(f"{path}: found no such video")
    video = cv2.VideoCapture(str(path))
    if not video.isOpened():
        raise ValueError(f"{path}: not a readable video: damaged, or no decoder for it")
    return video


def _count_pictures(path: Path) -> int:
    """Count by decoding, because the count in the header is often wrong."""
    video = _open_video(path)
    stated = int(max(video.get(cv2.CAP_PROP_FRAME_COUNT), 0))
    count = 0
    while video.grab():
        count += 1
    video.release()
    if count == 0 or count < 0.9 * stated:
        raise ValueError(
            f"{path}: camera {path.stem}: decoding stops at picture {count}, expected {stated}: "
            "damaged or truncated"
        )
    return count


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


def _natural(name: str) -> list[tuple[int, int | str]]:
    """Return a key that sorts numbers inside names by value."""
    parts = re.split(r"(\d+)", name)
    return [(0, int(part)) if part.isdecimal() else (1, part) for part in parts if part]
