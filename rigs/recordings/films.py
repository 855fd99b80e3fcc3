"""The formats of recordings: a table, and opening a file by it.

A format is a module with a class that takes a path and has the members of `Recording`, and one
line of the table.
"""

from __future__ import annotations

import os
import re
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING

from rigs.files.text import check_plain_file
from rigs.recordings.recording import Recording
from rigs.recordings.stills import TIFF_SUFFIXES

if TYPE_CHECKING:
    from rigs.recordings.film_formats.raw_film import RawLayout


@dataclass(frozen=True)
class FilmFormat:
    """A format of films: its module and class in `rigs.recordings.film_formats`.

    ``suffixes`` are empty where a folder or the user says which it is. ``holds_more``: such files
    may hold other things than films; ``has_members``: paths go on inside, ``film.h5:/entry/data``.
    """

    module: str
    reader: str
    suffixes: tuple[str, ...] = ()
    holds_more: bool = False
    has_members: bool = False


FILM_FORMATS = (
    FilmFormat("image_sequence", "ImageSequence"),
    FilmFormat("tiff_stack", "TiffStack", TIFF_SUFFIXES, holds_more=True),
    FilmFormat(
        "video", "Video",
        (".mp4", ".avi", ".mov", ".mkv", ".m4v", ".webm", ".mpg", ".mpeg", ".wmv"),
    ),
    FilmFormat("cine", "Cine", (".cine",)),
    FilmFormat("mraw", "Mraw", (".mraw", ".cihx", ".cih")),
    FilmFormat("im7", "Im7", (".im7",)),
    FilmFormat("hdf5", "Hdf5Film", (".h5", ".hdf5", ".nxs"), holds_more=True, has_members=True),
    FilmFormat("zarr_film", "ZarrFilm", (".zarr",), holds_more=True, has_members=True),
    FilmFormat("npy", "NpyFilm", (".npy",), holds_more=True),
    FilmFormat("raw_film", "RawFilm"),
)  # fmt: skip
"""Every format, in the order of the documentation."""

_ZARR_FILES = ("zarr.json", ".zarray", ".zgroup")  # tell a folder from others
_BESIDE = (".cihx", ".cih")  # describe a film whose pixels are in another file
FILM_SUFFIXES = tuple(
    suffix
    for one in FILM_FORMATS
    for suffix in one.suffixes
    if not one.holds_more and suffix not in _BESIDE
)
"""Suffixes that films alone have: a TIFF may be either a still image or a film."""

CONTAINER_SUFFIXES = tuple(
    suffix
    for one in FILM_FORMATS
    for suffix in one.suffixes
    if one.holds_more and suffix not in TIFF_SUFFIXES
)
"""Suffixes of files that hold arrays, which may be films."""

_MEMBER = re.compile(
    r"(.*\.(?:{})):(/.*)".format(
        "|".join(s[1:] for one in FILM_FORMATS if one.has_members for s in one.suffixes)
    ),
    re.IGNORECASE | re.DOTALL,
)


def is_film(path: Path) -> bool:
    """Return whether a file or folder is a film: a TIFF is one if it has pages of one size."""
    if path.is_dir():
        return _format_of_folder(path) != "image_sequence"
    suffix = path.suffix.lower()
    if not path.is_file():
        return False
    if suffix in TIFF_SUFFIXES:
        return import_module("rigs.recordings.film_formats.tiff_stack").is_stack(path)
    return suffix in FILM_SUFFIXES or suffix in CONTAINER_SUFFIXES


def split_member(path: str | os.PathLike) -> tuple[Path, str | None]:
    """Return the file of a film, and the name of the array in it where the path goes on.

    >>> split_member("film.h5:/entry/data")[1]
    '/entry/data'
    """
    found = _MEMBER.fullmatch(os.fspath(path))
    return (Path(found[1]), found[2]) if found else (Path(path), None)


def open_recording(path: str | os.PathLike, raw: RawLayout | None = None) -> Recording:
    """Return the frames of a camera in a folder of images, or in a film of one file.

    Parameters
    ----------
    path : path-like
        A file or folder; an array in it is named like ``film.h5:/entry/data``.
    raw : RawLayout, optional
        The description of a binary film that has none of its own.

    Raises
    ------
    ValueError
        If the file's suffix belongs to no format, it cannot be read, or a package for reading it
        is not installed.
    FileNotFoundError
        If there is nothing at ``path``.
    """
    file, member = split_member(path)
    if not file.exists():
        raise FileNotFoundError(f"{file}: no such recording")
    check_plain_file(file)
    if raw is not None:
        return _reader("raw_film", "RawFilm")(file, raw)
    if file.is_dir():
        name = _format_of_folder(file)
        if name == "image_sequence":
            from rigs.recordings.layout import images_in

            return _reader(name, "ImageSequence")(images_in(file), file)
        found = next((one for one in FILM_FORMATS if one.module == name), None)
    else:
        suffix = file.suffix.lower()
        found = next((one for one in FILM_FORMATS if suffix in one.suffixes), None)
    if found is None:
        known = ", ".join(suffix for one in FILM_FORMATS for suffix in one.suffixes)
        raise ValueError(
            f"{file}: recording: found suffix {file.suffix!r}, expected a folder of images, or "
            f"one of {known}; a binary film needs its description, raw: in scan.yaml"
        )
    reader = _reader(found.module, found.reader)
    return reader(file, member) if member is not None else reader(file)


def _format_of_folder(folder: Path) -> str:
    """Return the module of the format of a folder."""
    if any((folder / name).is_file() for name in _ZARR_FILES):
        return "zarr_film"
    has_im7 = any(one.suffix.lower() == ".im7" for one in folder.iterdir())
    return "im7" if has_im7 else "image_sequence"


def _reader(module: str, name: str) -> type:
    return getattr(import_module(f"rigs.recordings.film_formats.{module}"), name)
