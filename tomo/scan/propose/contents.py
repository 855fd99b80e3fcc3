"""What lies in a folder: images of light, dark and flat frames by their names, and rigs."""

from __future__ import annotations

import os
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path, PurePosixPath

from rigs.formats import rigs_in
from rigs.recordings import CONTAINER_SUFFIXES, FILM_SUFFIXES, IMAGE_SUFFIXES, is_film
from rigs.recordings.layout import natural
from tomo.grid import VoxelGrid
from tomo.scan.write import SCAN_FILE


class UndecidedError(ValueError):
    """Several things in a folder could be what a scan needs: one has to be named.

    The message begins with the folder and names what was looked for. ``choices`` are values of
    ``option``, the parameter of `propose_scan` that decides.
    """

    def __init__(self, where: object, what: str, choices: Sequence[str], option: str) -> None:
        self.choices, self.option = tuple(choices), option
        named = f"{', '.join(choices[:-1])} and {choices[-1]}"
        super().__init__(
            f"{where}: {what}: found {named}, expected one: {option}='{choices[0]}', say"
        )


NONE = "none"
"""As dark or flat: such frames are left out."""


@dataclass(frozen=True)
class Request:
    """What a user says of a folder; the rest is found in it."""

    rig: str | None = None  # in the folder or elsewhere: what `rigs.load` takes
    pattern: str | None = None  # how images are named, relative to the folder
    dark: str | float | None = None  # the value of scan.yaml, or none
    flat: str | float | None = None  # as dark
    channel: str | None = None
    bayer: str | None = None
    bit_depth: int | None = None
    rename: Mapping[str, str] = field(default_factory=dict)  # new names, by those of the rig
    drop: tuple[str, ...] = ()  # cameras to leave out
    length_unit: str | None = None  # the rig's, as `rigs.load` takes it
    grid: VoxelGrid | None = None
    box: tuple[tuple[float, ...], tuple[float, ...]] | None = None  # its corners, without voxels
    voxel: float | None = None  # its edge, where only the box is proposed


RIG_FILE, THUMBNAILS = "rig.yaml", "thumbnails.png"
"""Beside scan.yaml, what is written into the folder; the second is no image of a camera."""

KINDS = {"dark": ("dark", "background"), "flat": ("flat",)}
"""Corrections, and how words in the names of their images' files or folders begin."""

_RESULTS = ("report.json", "volume.npz")  # a folder that has one was written by a command


@dataclass(frozen=True)
class Contents:
    """The images in a folder, relative to it, by what their names say that they show."""

    folder: Path
    light: tuple[PurePosixPath, ...]  # images and films of emission
    dark: tuple[PurePosixPath, ...]  # without light, or with background light
    flat: tuple[PurePosixPath, ...]  # of even light

    @classmethod
    def of(cls, folder: Path) -> Contents:
        """Look into a folder and those in it, but for hidden files and what commands wrote."""
        if not folder.is_dir():
            kind = NotADirectoryError if folder.exists() else FileNotFoundError
            raise kind(f"{folder}: found no such folder, expected one with images")
        found: dict[str, list[PurePosixPath]] = {"": [], **{kind: [] for kind in KINDS}}
        for path in sorted(_images(folder), key=lambda path: natural(path.as_posix())):
            found[kind_of(path)].append(path)
        return cls(folder, tuple(found[""]), tuple(found["dark"]), tuple(found["flat"]))

    def check_light(self) -> None:
        """Raise if there is no image of emission."""
        if self.light:
            return
        taken = next(
            (
                f"; {len(own)} are taken for {kind} frames by their names, like {own[0]}: "
                "pattern='FOLDER/{camera}/{frame}.tif' says otherwise"
                for kind, own in (("dark", self.dark), ("flat", self.flat))
                if own
            ),
            "",
        )
        raise ValueError(
            f"{self.folder}: images: found none, expected files that end in "
            f"{', '.join(IMAGE_SUFFIXES)}, or films{taken}"
        )


def kind_of(path: PurePosixPath) -> str:
    """Return the correction that an image is for by its name or a folder's, or nothing."""
    text = path.with_suffix("").as_posix().lower()
    for kind, words in KINDS.items():
        if re.search(rf"(?<![a-z])({'|'.join(words)})(s|frames?|fields?)?(?![a-z])", text):
            return kind
    return ""


def find_rig(folder: Path) -> tuple[Path, str, list[str]]:
    """Return the nearest rig in a folder or the folders in it, its format, and other rigs' names.

    A ``rig.yaml`` comes before others, then a ``transforms.json``, which make a folder a rig.
    """
    level: list[Path] = [folder]
    found: list[tuple[Path, str]] = []
    while level and not found:
        found = [rig for one in level for rig in _rigs_in(one)]
        inside = (one for place in level for one in sorted(place.iterdir()) if _is_seen(one))
        level = [one for one in inside if one.is_dir() and not one.is_symlink()]
    names = [path.relative_to(folder).as_posix() for path, _ in found]
    for name, form in ((RIG_FILE, "emission_rig"), ("transforms.json", "transforms")):
        if (folder / name).is_file():
            return folder / name, form, [one for one in names if one != name]
    if len(found) > 1:
        raise UndecidedError(folder, "rigs", names, "rig")
    if not found:
        raise FileNotFoundError(
            f"{folder}: rig: found none, expected a rig.yaml, a file of a calibration, or a table "
            "cameras.csv with the head name,x_mm,y_mm,z_mm,look_x_mm,look_y_mm,look_z_mm,"
            "focal_mm,pitch_um; rig='FILE' names one elsewhere, calibrate-rig makes one of images"
        )
    return *found[0], []


def _rigs_in(folder: Path) -> list[tuple[Path, str]]:
    return [(path, form) for path, form in rigs_in(folder) if path.name != SCAN_FILE]


def _images(folder: Path) -> Iterator[PurePosixPath]:
    """Yield the images and films in a folder."""
    suffixes = {*IMAGE_SUFFIXES, *FILM_SUFFIXES, *CONTAINER_SUFFIXES}
    for place, folders, files in os.walk(folder):
        at = Path(place)
        if at != folder and any(name in files for name in _RESULTS):
            folders.clear()
            continue
        inside = [at / name for name in folders if _is_seen(at / name)]
        films = [one for one in inside if is_film(one)]
        folders[:] = sorted(one.name for one in inside if one not in films)
        named = [at / name for name in files if Path(name).suffix.lower() in suffixes]
        for path in [*films, *named]:
            if _is_seen(path) and path != folder / THUMBNAILS:
                yield PurePosixPath(path.relative_to(folder).as_posix())


def _is_seen(path: Path) -> bool:
    return not path.name.startswith(".")
