"""Bundler's ``bundle.out``: focal length, two radial terms, R and t of each image of a list.

After the line ``# Bundle file v0.3`` and the numbers of images and points, an image has
``f k1 k2``, three rows of R and one of t. It looks along -z with y up::

    P = R X + t,   p = -(Px, Py) / Pz,   pixel = f (1 + k1 |p|^2 + k2 |p|^4) p

from the middle of the image, x to the right and y up. Names are those of ``list.txt`` beside the
file or one folder above. An image with f = 0 was not oriented. Source: Snavely,
"Bundler v0.4 user's manual",
https://www.cs.cornell.edu/~snavely/bundler/bundler-v0.4-manual.html.
"""

from __future__ import annotations

from collections.abc import Iterator
from itertools import islice
from pathlib import Path

import numpy as np

from rigs.camera import Camera
from rigs.files.text import iter_lines, shortened
from rigs.formats._values import (
    as_count,
    as_rotation,
    errors_of,
    image_listed,
    numbers_of_line,
    required_size,
)
from rigs.formats._views import Views
from rigs.lens import Distortion
from rigs.rig import Rig

_HEAD = "# Bundle file"
_LENS = ("f", "k1", "k2")
_TURN = [[f"R{i}{j}" for j in "123"] for i in "123"]
_SHIFT = ("t1", "t2", "t3")


def looks_like(path: Path, head: str) -> bool:
    """Return whether ``head``, the file's first characters, is Bundler's."""
    return head.startswith(_HEAD)


def load(path: Path, image_size: tuple[int, int] | None = None) -> Rig:
    """Return the rig of a ``bundle.out``."""
    lines = iter_lines(path)
    head = next(lines, "")
    if not head.startswith(_HEAD):
        raise ValueError(f"found {shortened(head)}, expected {_HEAD} v0.3")
    counts = next(lines, "").split()
    count = as_count(counts[0] if counts else None, "number of cameras")
    folder, names = _names(path, count)
    views = Views(path)
    for name in names if names else (f"camera{i}" for i in range(count)):
        image, file = image_listed(folder, name)
        with errors_of(f"image {name}"):
            camera = _camera(lines, image_size, file if names else None)
        if camera is None:
            views.lost.append(name)
        else:
            views.add(str(image), camera)
    return views.rig()


def _names(path: Path, count: int) -> tuple[Path, list[str]]:
    """Return the folder of the list of images, and their names; none without a list."""
    for file in (path.parent / "list.txt", path.parent.parent / "list.txt"):
        if file.is_file():
            names = [line.split()[0] for line in iter_lines(file)]
            if len(names) != count:
                raise ValueError(f"cameras: found {count}, expected {len(names)} as in {file}")
            return file.parent, names
    return path.parent, []


def _camera(
    lines: Iterator[str], image_size: tuple[int, int] | None, file: Path | None
) -> Camera | None:
    """Return the camera of the next five lines; None if it is not oriented."""
    rows = [line.split() for line in islice(lines, 5)]
    if len(rows) < 5:
        raise ValueError("found the file's end, expected f k1 k2, three rows of R, and t")
    f, k1, k2 = numbers_of_line(rows[0], _LENS)
    turn = [numbers_of_line(row, names) for row, names in zip(rows[1:4], _TURN, strict=True)]
    shift = numbers_of_line(rows[4], _SHIFT)
    if f == 0:
        return None
    to_opencv = np.diag([1.0, -1.0, -1.0])
    R, t = to_opencv @ as_rotation(turn, "R"), to_opencv @ shift
    width, height = required_size(image_size, "Bundler", file)
    K = [[f, 0.0, (width - 1) / 2], [0.0, f, (height - 1) / 2], [0.0, 0.0, 1.0]]
    lens = Distortion("brown", (k1, k2, 0.0, 0.0)) if k1 or k2 else Distortion()
    return Camera("entry", (width, height), K, lens, R, t, status="calibrated")
