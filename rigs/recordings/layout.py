"""Which image belongs to which camera and moment, by the names of files and folders."""

from __future__ import annotations

import os
import re
from collections.abc import Collection, Iterable, Mapping, Sequence
from itertools import takewhile
from pathlib import Path

from rigs.recordings.stills import IMAGE_SUFFIXES

Images = dict[str, dict[str, Path]]
"""Camera to frame to file, in natural order: ``cam2`` before ``cam10``."""

ONLY = "0"
"""The frame of a camera's only image, where its name is the camera's."""

_BETWEEN = "_-. "  # stand between a camera's name and a frame's
_EXAMPLE = "{camera}_{frame}.tif"
_TOUCHING = re.compile(r"\{camera\}\{frame\}|\{frame\}\{camera\}")
_LAYOUTS = "cam00/0001.tif, cam00/cam00_0001.tif, cam00_0001.tif or cam00.tif"


def find_images(
    folder: str | os.PathLike,
    cameras: Sequence[str] | None = None,
    pattern: str | None = None,
    suffixes: Iterable[str] = IMAGE_SUFFIXES,
) -> Images:
    """Return the images in a folder by camera and frame.

    Parameters
    ----------
    folder : path-like
        It holds ``cam00/0001.tif``, ``cam00/cam00_0001.tif``, ``cam00_0001.tif`` (with the names
        of ``cameras`` also ``0001_cam00.tif``) or ``cam00.tif``. Names that begin with a dot and
        files of other kinds are ignored.
    cameras : sequence of str, optional
        The cameras' names. Without them folders are cameras, and so is what stands before the
        number of a file beside them.
    pattern : str, optional
        Where the camera's and the frame's name stand in a path inside the folder, like
        ``{camera}_{frame}.tif``; ``*`` is any text without a slash.
    suffixes : iterable of str
        The endings of images' names.

    Returns
    -------
    images : dict of camera to dict of frame to path
        Those of ``cameras`` alone where they are given; cameras without an image are left out.

    Raises
    ------
    ValueError
        If names fit no layout, one camera has one frame twice, or the pattern is none.
    FileNotFoundError
        If there is no such folder.
    """
    folder, suffixes = Path(folder), tuple(suffixes)
    if not folder.is_dir():
        raise FileNotFoundError(f"{folder}: no such folder of images")
    if pattern is not None:
        found = _by_pattern(folder, pattern, cameras)
    else:
        found = _by_names(folder, cameras, suffixes)
    images: Images = {}
    for camera, frame, path in found:
        if cameras is not None and camera not in cameras:
            continue
        of_camera = images.setdefault(camera, {})
        if frame in of_camera:
            raise ValueError(
                f"{path}: camera {camera}: found the frame {frame!r} twice, "
                f"{of_camera[frame].name} is another, expected one image"
            )
        of_camera[frame] = path
    return {
        camera: dict(sorted(images[camera].items(), key=lambda item: natural(item[0])))
        for camera in sorted(images, key=natural)
    }


def cameras_and_frames(images: Mapping[str, Collection[str]]) -> str:
    """Return the cameras of images, and how many frames each has, in words."""
    counts = {camera: len(frames) for camera, frames in images.items()}
    each = ", ".join(f"{camera} ({count})" for camera, count in counts.items())
    return f"images of {len(counts)} cameras, and how many of each: {each}"


def natural(name: str) -> list[tuple[int, int | str]]:
    """Return a key that sorts numbers inside names by value."""
    parts = re.split(r"(\d+)", name)
    return [(0, int(part)) if part.isdecimal() else (1, part) for part in parts if part]


def how_to_name(paths: Sequence[Path], folder: Path, cameras: Sequence[str] | None) -> str:
    """Return how files have to be named, and the pattern to write for those that are there."""
    inside = [path.relative_to(folder).as_posix() for path in paths]
    known = (_pattern_around(path, cameras) for path in inside) if cameras else ()
    pattern = next(filter(None, known), None) or _pattern_between(inside) or _EXAMPLE
    return f"files named {_LAYOUTS}, or their pattern, like --pattern '{pattern}'"


def _pattern_around(path: str, cameras: Sequence[str]) -> str | None:
    """Return the pattern of a path that holds a camera's name; its last number is the frame."""
    for camera in sorted(cameras, key=len, reverse=True):
        before, name, after = path.partition(camera)
        if name:
            *_, last = [None, *re.finditer(r"\d+", after)]
            if last is not None:
                after = f"{after[: last.start()]}{{frame}}{after[last.end() :]}"
            return f"{before}{{camera}}{after}"
    return None


def _to_word(text: str) -> str:
    """Return a text up to and with its last sign that is not of a word."""
    found = re.match(r".*[\W_]", text)
    return found[0] if found else ""


def _pattern_between(paths: Sequence[str]) -> str | None:
    """Return the pattern of paths that differ in one word; None where numbers differ too."""
    start = _to_word(common_start(paths))
    backwards = common_start([path[::-1] for path in paths])
    end = _to_word(backwards)[::-1]
    words = {path[len(start) : len(path) - len(end)] for path in paths}
    if len(words) < 2 or any(re.search(r"\d|/", word) or not word for word in words):
        return None
    return f"{start}{{camera}}{end}"


def common_start(texts: Sequence[str]) -> str:
    """Return the letters that all texts begin with."""
    alike = takewhile(lambda letters: len(set(letters)) == 1, zip(*texts, strict=False))
    return "".join(letters[0] for letters in alike)


def _by_names(
    folder: Path, cameras: Sequence[str] | None, suffixes: tuple[str, ...]
) -> Iterable[tuple[str, str, Path]]:
    """Yield camera, frame and path of each image, in the layouts that need no pattern."""
    inside = [path for path in folder.iterdir() if not path.name.startswith(".")]
    inside.sort(key=lambda path: natural(path.name))
    folders = [path for path in inside if path.is_dir()]
    if cameras is not None:
        folders = [path for path in folders if path.name in cameras]
    for camera in folders:
        images = images_in(camera, suffixes)
        frames = [_frame_of(path.stem, camera.name) for path in images]
        names = [frame for frame in frames if frame is not None]
        if len(names) < len(images):  # the camera's name is in some by chance
            names = [path.stem for path in images]
        yield from zip([camera.name] * len(images), names, images, strict=True)
    loose = [path for path in inside if _is_image(path, suffixes)]
    taken = {path.name for path in folders}
    if cameras is None:
        if not any(images_in(path, suffixes) for path in folders):
            yield from _numbered(loose)
        return
    for path in loose:
        for name in sorted(cameras, key=len, reverse=True):
            frame = _frame_of(path.stem, name)
            if frame is not None:
                if name not in taken:
                    yield name, frame, path
                break


def images_in(folder: Path, suffixes: Iterable[str] = IMAGE_SUFFIXES) -> list[Path]:
    """Return the images of a folder, in natural order."""
    found = [path for path in folder.iterdir() if _is_image(path, tuple(suffixes))]
    return sorted(found, key=lambda path: natural(path.name))


def _is_image(path: Path, suffixes: tuple[str, ...]) -> bool:
    is_kind = path.suffix.lower() in suffixes and not path.name.startswith(".")
    return is_kind and path.is_file()


def _frame_of(stem: str, camera: str) -> str | None:
    """Return what a file's stem holds beside the camera's name; None where it is not in it."""
    if stem == camera:
        return ONLY
    if stem.startswith(camera) and stem[len(camera)] in _BETWEEN:
        return stem[len(camera) :].lstrip(_BETWEEN) or None
    if stem.endswith(camera) and stem[-len(camera) - 1] in _BETWEEN:
        return stem[: -len(camera)].rstrip(_BETWEEN) or None
    return None


def _numbered(paths: Sequence[Path]) -> Iterable[tuple[str, str, Path]]:
    """Yield camera, frame and path of files ``CAMERA_NUMBER``; nothing where one is not."""
    # words before the number of every camera are the frame's: pose_01 of left_pose_01
    numbered = re.compile(r"(.*[^\d_\-. ].*)[_\-. ]+(\d+)")
    matches = [numbered.fullmatch(path.stem) for path in paths]
    split = [match for match in matches if match is not None]
    if len(split) < len(matches):
        return
    before = {match[1].rstrip(_BETWEEN) for match in split}
    end = common_start([name[::-1] for name in before])[::-1] if len(before) > 1 else ""
    found = re.search(r"[_\-. ].*|$", end)
    words = found[0] if found else ""
    for path, match in zip(paths, split, strict=True):
        camera = match[1].rstrip(_BETWEEN).removesuffix(words)
        yield camera, path.stem[len(camera) :].lstrip(_BETWEEN), path


def _by_pattern(
    folder: Path, pattern: str, cameras: Sequence[str] | None
) -> Iterable[tuple[str, str, Path]]:
    """Yield camera, frame and path of the files that a pattern fits."""
    if pattern.count("{camera}") != 1 or pattern.count("{frame}") > 1:
        raise ValueError(
            f"pattern: found {pattern!r}, expected {{camera}} once, and {{frame}} where several "
            f"moments were recorded, like {_EXAMPLE!r}"
        )
    if pattern.startswith("/") or ".." in pattern.split("/") or "\\" in pattern:
        raise ValueError(f"pattern: found {pattern!r}, expected a path inside {folder}")
    paths = sorted(folder.glob("/".join(["*"] * (pattern.count("/") + 1))))
    known = [None] if cameras is None else sorted(cameras, key=len, reverse=True)
    fits = [re.compile(_expression(pattern, camera)) for camera in known]
    for path in paths:
        inside = path.relative_to(folder).as_posix()
        found = list(filter(None, (one.fullmatch(inside) for one in fits)))
        if not found or not path.is_file() or path.name.startswith("."):
            continue
        named = [match.groupdict() for match in found]
        if len(named) > 1 and _TOUCHING.search(pattern):
            raise ValueError(
                f"{path}: pattern: found a name that fits the cameras {named[0]['camera']} and "
                f"{named[1]['camera']}, expected one: a pattern with a sign between camera and "
                "frame, or other names"
            )
        yield named[0]["camera"], named[0].get("frame", ONLY), path


def _expression(pattern: str, camera: str | None) -> str:
    """Return the regular expression of a pattern, for one camera where it is named."""
    # where a camera and a frame touch, the frame takes all digits: left12 is left, 12
    meanings = {
        "{camera}": f"(?P<camera>{'[^/]+' if camera is None else re.escape(camera)})",
        "{frame}": "(?P<frame>[^/]+?)",
        "*": "[^/]*",
    }
    texts = [text for text in re.split(r"(\{camera\}|\{frame\}|\*)", pattern) if text]
    found = "".join(meanings.get(text) or re.escape(text) for text in texts)
    if camera is None and _TOUCHING.search(pattern):
        between = found.index(")(?P<") + 1
        found = f"{found[:between]}(?:(?<!\\d)|(?!\\d)){found[between:]}"
    return found
