"""Projection matrices: text files of three rows of four numbers, one camera each, or a folder.

Read only. ``P (X, 1)`` is the pixel's ``(u w, v w, w)``; pixel centres are taken at integers, rows
from the top. PMVS's files, with ``CONTOUR`` in the first line, and DTU's ``pos_001.txt`` are such
files. The camera is named by its file. There is no distortion and no unit. The files hold no image
size: it is that of the image of the same name beside them or in PMVS's ``../visualize``, else it
is asked for. Source: documentation of PMVS-2, https://www.di.ens.fr/pmvs/documentation.html;
README of the DTU sets, https://roboimagedata.compute.dtu.dk.
"""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np

from rigs.camera import Camera
from rigs.files.text import read_text
from rigs.files.units import UNKNOWN
from rigs.formats._image_size import image_beside, required_size
from rigs.formats._one_a_camera import cameras_of
from rigs.formats._projection import camera_of_matrix, look_away
from rigs.formats._values import errors_of, numbers_of_line, read_head
from rigs.rig import Rig

_ENDINGS = (".txt", ".dat", ".csv", ".p", ".proj")  # of files in a folder that are looked into
_NUMBER = r"[-+]?(?:\d++\.?\d*+|\.\d++)(?:[eE][-+]?\d++)?"
_BETWEEN = r"(?:[^\S\n]*+[,;][^\S\n]*+|[^\S\n]++)"
_ROW = rf"[^\S\n]*+{_NUMBER}(?:{_BETWEEN}{_NUMBER}){{3}}[^\S\n]*+"
_MATRIX = re.compile(rf"\s*+(?:CONTOUR[^\S\n]*+\n\s*+)?{_ROW}\n{_ROW}\n{_ROW}\s*+")
_NAMES = [f"P{row}{column}" for row in "123" for column in "1234"]


def looks_like(path: Path, head: str) -> bool:
    """Return whether a file is one matrix, or a folder holds such files."""
    if path.is_dir():
        return bool(_files_of(path))
    return _MATRIX.fullmatch(head) is not None


def load(path: Path, image_size: tuple[int, int] | None = None) -> Rig:
    """Return the rig of a matrix's file, or of a folder of them.

    Parameters
    ----------
    path : Path
    image_size : (int, int), optional
        Width and height of all images; by default those of the images of the same names.
    """
    what = "files of 3 x 4 numbers, expected one a camera"
    cameras = cameras_of(path, _files_of, lambda file: _camera(file, image_size), what)
    if look_away(cameras):
        raise ValueError(
            "P: found cameras that look away from the point where their axes meet, expected "
            "rows that count from the top of the image"
        )
    return Rig(cameras, UNKNOWN, f"as in {path.name}")


def _files_of(folder: Path) -> list[Path]:
    """Return the files of a folder that are matrices."""
    files = [file for file in sorted(folder.iterdir()) if file.suffix.lower() in _ENDINGS]
    return [file for file in files if file.is_file() and _MATRIX.fullmatch(read_head(file))]


def _camera(file: Path, image_size: tuple[int, int] | None) -> Camera:
    """Return the camera of a file."""
    words = re.split(r"\s*[,;]\s*|\s+", read_text(file).strip().removeprefix("CONTOUR").strip())
    with errors_of(f"camera {file.stem}"):
        P = np.array(numbers_of_line(words, _NAMES)).reshape(3, 4)
        folders = (file.parent, file.parent.parent / "visualize")
        size = required_size(image_size, "projection matrix", image_beside(folders, file.stem))
        return camera_of_matrix(P, file.stem, size)
