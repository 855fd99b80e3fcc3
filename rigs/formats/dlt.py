"""The eleven coefficients of the direct linear transformation, by DLTdv, easyWand and Argus.

Read only: a table of numbers without a head, a column of eleven a camera (or a row of eleven,
where the table is not eleven high). The pixel of X, Y, Z is::

    u = (L1 X + L2 Y + L3 Z + L4) / w,   v = (L5 X + L6 Y + L7 Z + L8) / w,
    w = L9 X + L10 Y + L11 Z + 1

That is a pinhole with skew. Cameras are named cam1, cam2, ...; the files hold no image size, no
unit, and no lens: images must be undistorted first. Nor do they say where pixels count from. Here
(0, 0) is the centre of the top-left pixel; ``dlt_matlab`` counts from 1 (DLTdv8, easyWand), and
``dlt_bottom`` from 1 at the bottom-left pixel, v upwards (DLTdv 3 to 7, Argus).

Cameras that look away from the point where their axes meet show that rows count from the other
edge, or that the file's world is left-handed: where the format was chosen by name, Z is negated.
Source:
Abdel-Aziz and Karara, "Direct linear transformation" (1971); ``dlt_inverse.m`` and
``dlt_invert.m`` at https://github.com/tlhedrick/dltdv; ``tools.py`` at
https://github.com/kilmoretrout/argus_gui.
"""

from __future__ import annotations

import logging
import re
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from rigs.camera import Camera
from rigs.files.text import read_text
from rigs.files.units import UNKNOWN
from rigs.formats._values import as_number, errors_of, required_size
from rigs.formats.projection import camera_of_matrix, look_away
from rigs.rig import Rig

logger = logging.getLogger(__name__)

_ENDINGS = (".csv", ".txt", ".dat", ".dlt")


def looks_like(path: Path, head: str) -> bool:
    """Return whether a file is a table of numbers, eleven high or eleven wide."""
    if path.suffix.lower() not in _ENDINGS:
        return False
    rows = _rows(head)
    try:
        [float(word) for row in rows for word in row]
    except ValueError:
        return False
    return len({len(row) for row in rows}) == 1 and 11 in (len(rows), len(rows[0]))


def load(
    path: Path,
    image_size: tuple[int, int] | None = None,
    *,
    first: int | None = None,
    bottom: bool = False,
) -> Rig:
    """Return the rig of a table whose first pixel is number ``first``, unknown where None."""
    table = _table(read_text(path))
    size = required_size(image_size, "DLT")
    # pixel = count @ (u, v, 1), with v from the top
    count = np.array([[1.0, 0, -(first or 0)], [0, 1, -(first or 0)], [0, 0, 1]])
    if bottom:
        count[1] = [0, -1, size[1] - 1 + (first or 0)]
    matrices = [count @ np.append(values, 1.0).reshape(3, 4) for values in table.T]
    cameras, frame = _cameras(matrices, size), f"as in {path.name}"
    if _looks_away(cameras):
        if first is None:
            raise ValueError(
                "L1 ... L11: found cameras that look away from their scene, expected rows "
                "counted from the top in a right-handed world: convert-rig --from dlt_bottom "
                "or dlt_matlab says how they count"
            )
        logger.warning(
            "%s: Z is negated: with rows counted from the %s its cameras look away from their "
            "scene, so the world of the file is left-handed, or rows count from the other "
            "edge",
            path,
            "bottom" if bottom else "top",
        )
        mirror = np.diag([1.0, 1.0, -1.0, 1.0])
        cameras, frame = _cameras([P @ mirror for P in matrices], size), f"{frame}, Z negated"
    if first is None:
        logger.warning(
            "%s: pixels are counted from (0, 0) at the top left, as the file does not say: DLTdv8 "
            "and easyWand count from 1 (convert-rig --from dlt_matlab), Argus and older DLTdv "
            "from the bottom (--from dlt_bottom)",
            path,
        )
    return Rig(tuple(cameras), UNKNOWN, frame)


def _cameras(matrices: list[NDArray], size: tuple[int, int]) -> list[Camera]:
    """Return cam1, cam2, ... of projection matrices."""
    cameras = []
    for number, P in enumerate(matrices, 1):
        with errors_of(f"camera cam{number}"):
            cameras.append(camera_of_matrix(P, f"cam{number}", size))
    return cameras


def _looks_away(cameras: list[Camera]) -> bool:
    """Return whether cameras look away from where their axes meet, else from the origin."""
    away = look_away(cameras)
    return all(camera.t[2] < 0 for camera in cameras) if away is None else away


def _rows(text: str) -> list[list[str]]:
    """Return the words of each line that is not empty."""
    lines = [line.strip() for line in text.splitlines() if line.strip()]
    return [re.split(r"\s*[,;]\s*|\s+", line) for line in lines]


def _table(text: str) -> NDArray[np.float64]:
    """Return the coefficients, ``(11, cameras)``."""
    rows = _rows(text)
    if not rows or len({len(row) for row in rows}) > 1:
        raise ValueError(f"found {len(rows)} rows of unequal length, expected 11 rows of numbers")
    table = np.array(
        [[as_number(word, f"row {i}") for word in row] for i, row in enumerate(rows, 1)]
    )
    if 11 not in table.shape:
        raise ValueError(
            f"found {len(rows)} rows of {len(rows[0])} numbers, expected 11 rows, a column each "
            "camera"
        )
    return table if len(table) == 11 else table.T
