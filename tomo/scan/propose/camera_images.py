"""Which images in a folder are of which camera and moment: by their names, or not at all."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from pathlib import Path, PurePosixPath

from rigs import Rig
from rigs.files.size_guard import path_inside
from rigs.recordings import find_images, image_size, is_film
from rigs.recordings.layout import natural
from rigs.recordings.naming import Named, patterns_of
from tomo.scan.films import Film, FilmFrame, Frame, frames_of_films
from tomo.scan.image_folder import frames_of_images
from tomo.scan.propose.contents import Contents, UndecidedError

_USUAL = "images/"
"""Where a scan's images are by convention: they come before those of other folders."""


@dataclass(frozen=True)
class CameraImages:
    """The images of a rig's cameras."""

    pattern: str  # how they are named, as scan.yaml has it
    frames: tuple[Frame, ...]
    films: dict[str, Film] = field(default_factory=dict)  # by camera; empty where images are files
    is_pattern_enough: bool = True  # it finds these and no others
    others: tuple[str, ...] = ()  # patterns of other images that could be meant

    @property
    def moments(self) -> tuple[Frame, Frame, Frame]:
        """The first, the middle and the last of the frames with an image of every camera."""
        most = max(len(frame.images) for frame in self.frames)
        whole = [frame for frame in self.frames if len(frame.images) == most]
        return whole[0], whole[len(whole) // 2], whole[-1]


def images_of(
    contents: Contents, rig: Rig, pattern: str | None = None, dropped: Sequence[str] = ()
) -> CameraImages:
    """Return the images of a rig's cameras in a folder."""
    folder, names = contents.folder, rig.names
    if pattern is not None:
        found = {pattern: _named(folder, names, pattern)}
    else:
        found = patterns_of(contents.light, names)
    whole = {one: named for one, named in found.items() if set(named) == set(names)}
    usual = [one for one in whole if one.startswith(_USUAL)]
    if not whole:
        raise _missing(contents, rig, found, pattern)
    if len(whole) > 1 and len(usual) != 1:
        raise UndecidedError(folder, "images of all cameras", list(whole), "pattern")
    chosen = usual[0] if len(usual) == 1 else next(iter(whole))
    for camera, own in whole[chosen].items():
        for path in own.values():
            path_inside(str(path), folder, f"{folder}: images: camera {camera}", "scan's")
    _refuse_strangers(contents, (*rig.names, *dropped), chosen)
    others = tuple(one for one in whole if one != chosen)
    films = _films(folder, chosen, whole[chosen])
    if films:
        return CameraImages(chosen, frames_of_films(films), films, False, others)
    files = {n: {f: folder / path for f, path in whole[chosen][n].items()} for n in names}
    is_enough = _named(folder, names, chosen) == whole[chosen]
    return CameraImages(chosen, frames_of_images(files), {}, is_enough, others)


def renamed_as_images(contents: Contents, rig: Rig) -> dict[str, str]:
    """Return the names that images give a rig's cameras, where they differ in writing alone.

    ``cam1``, ``Cam_01`` and ``camera-1`` are one. Nothing where each has its name, or not just
    one.
    """
    if any(
        set(named) == set(rig.names) for named in patterns_of(contents.light, rig.names).values()
    ):
        return {}
    written: dict[tuple[str | int, ...], set[str]] = {}
    for name in _names_of_cameras(contents):
        written.setdefault(_spoken(name), set()).add(name)
    own = [written.get(_spoken(name), set()) for name in rig.names]
    if any(len(each) != 1 for each in own) or len(set.union(*own)) < len(own):
        return {}
    return {name: each.pop() for name, each in zip(rig.names, own, strict=True)}


def sizes_of(images: Iterable[Path | FilmFrame]) -> dict[tuple[int, int], Path]:
    """Return the sizes of images, width and height, and the first file that has each."""
    found: dict[tuple[int, int], Path] = {}
    for image in images:
        if isinstance(image, FilmFrame):
            rows, columns = image.film.recording.read(image.place).shape[:2]
            found.setdefault((columns, rows), image.film.path)
        else:
            found.setdefault(image_size(image), image)
    return found


def check_sizes(rig: Rig, images: CameraImages) -> None:
    """Raise unless all images of each camera have the size that the rig says."""
    frames = images.moments[:1] if images.films else images.frames
    for camera in rig:
        own = (frame.images[camera.name] for frame in frames if camera.name in frame.images)
        try:
            found = sizes_of(one for one in own if isinstance(one, Path | FilmFrame))
        except ValueError as error:
            raise ValueError(f"camera {camera.name}: {error}") from None
        (size, first), *more = found.items()
        if more:
            (other, path), *_ = more
            raise ValueError(
                f"{path}: camera {camera.name}: found {_times(other)} pixels, expected "
                f"{_times(size)} as in {first.name}: one size for all images of a camera"
            )
        if size != tuple(camera.image_size):
            raise ValueError(
                f"{first}: camera {camera.name}: found {_times(size)} pixels, expected "
                f"{_times(camera.image_size)}, the rig's image_size; where images were cropped, "
                "turned or binned, change the rig alike: flametomo convert-rig --crop, --rotate, "
                "--scale"
            )


def _times(size: Sequence[int]) -> str:
    return f"{size[0]} x {size[1]}"


def _named(folder: Path, cameras: Sequence[str] | None, pattern: str) -> Named:
    """Return the images that a pattern finds, relative to the folder."""
    return {
        camera: {frame: PurePosixPath(path.relative_to(folder)) for frame, path in own.items()}
        for camera, own in find_images(folder, cameras, pattern).items()
    }


def _films(folder: Path, pattern: str, named: Named) -> dict[str, Film]:
    """Return the films of cameras; nothing where their images are stills."""
    firsts = {camera: folder / next(iter(own.values())) for camera, own in named.items()}
    kinds = {camera: is_film(path) for camera, path in firsts.items()}
    if not any(kinds.values()):
        return {}
    if not all(kinds.values()):
        film, still = (next(c for c in kinds if kinds[c] == is_one) for is_one in (True, False))
        raise ValueError(
            f"{firsts[still]}: camera {still}: found a single image, expected a film as "
            f"{firsts[film].name} of camera {film} is"
        )
    runs = dict.fromkeys(frame for own in named.values() for frame in own)
    if len(runs) > 1:
        choices = [pattern.replace("{frame}", run) for run in runs]
        raise UndecidedError(folder, "films of all cameras", choices, "pattern")
    return {camera: Film(path) for camera, path in firsts.items()}


def _names_of_cameras(contents: Contents) -> list[str]:
    """Return what could be names of cameras: of folders, and of files before a number."""
    folders = {part for path in contents.light for part in path.parts[:-1]}
    stems = {re.sub(r"[_\-. ]+\d+$", "", path.stem) for path in contents.light}
    return sorted(folders | stems | {path.stem for path in contents.light}, key=natural)


def _spoken(name: str) -> tuple[str | int, ...]:
    """Return the words and numbers of a camera's name: those of ``Cam_01`` are cam and 1."""
    words = re.findall(r"[^\W\d_]+|\d+", name.casefold())
    return tuple(int(w) if w.isdecimal() else re.sub("^camera$", "cam", w) for w in words)


def _missing(
    contents: Contents, rig: Rig, found: dict[str, Named], pattern: str | None
) -> ValueError:
    """Return the error about images that are not of all cameras."""
    folder = contents.folder
    if not found or not any(found.values()):
        if pattern is not None:
            return ValueError(f"{folder}: pattern: found no image named {pattern!r}, expected one "
                              f"of each camera {', '.join(rig.names)}")  # fmt: skip
        called = Counter(path.parts[0] if len(path.parts) > 1 else path.name
                         for path in contents.light)  # fmt: skip
        return ValueError(
            f"{folder}: images: found {len(contents.light)}, in or named {_some(list(called))}, "
            f"none named as a camera of the rig, {_some(rig.names)}; expected "
            "cam00/0001.tif or cam00_0001.tif: rename='CAMERA=NAME' gives a camera of the rig the "
            "images' name, pattern='...' says where the name stands"
        )
    best = max(found, key=lambda one: len(found[one]))
    camera = next(name for name in rig.names if name not in found[best])
    return ValueError(
        f"{folder}: camera {camera}: found no image named {best}, as {len(found[best])} of "
        f"{len(rig)} cameras have; expected one, or drop='{camera}', which takes it out of the rig"
    )


def _refuse_strangers(contents: Contents, known: Sequence[str], pattern: str) -> None:
    """Raise if images named alike are of a camera that is not known."""
    light = set(contents.light)
    for camera, own in _named(contents.folder, None, pattern).items():
        if camera not in known and light & set(own.values()):
            path = next(path for path in own.values() if path in light)
            raise ValueError(
                f"{contents.folder / path}: camera {camera}: found no such camera in the rig, "
                f"expected one of {_some(known)}; drop='{camera}' leaves its images out"
            )


def _some(names: Sequence[str]) -> str:
    """Return names, the first ones of many."""
    return ", ".join(names[:6]) + (" ..." if len(names) > 6 else "")
