"""VisualSFM's ``.nvm``: one line an image, ``name f QW QX QY QZ Cx Cy Cz k 0``.

Read only. After ``NVM_V3`` come the number of images and their lines. The rotation is world to
camera in OpenCV's axes, C the camera's centre. ``NVM_V3_R9T`` has nine numbers of R and three of t
in their place. The principal point is the image's middle; ``NVM_V3 FixedK fx cx fy cy`` gives it,
and both focal lengths, for all. k bends the image towards the pinhole, p' = p (1 + k |p|^2) with p
in focal lengths from the principal point: a radial lens is fitted, and where none fits, the camera
becomes a table of rays. Spaces in names are written as ``"``. Image sizes are those of the images,
else asked for; there is no unit. A file may hold several models: the first is read, and a warning
names the others. Source:
http://ccwu.me/vsfm/doc.html#nvm; ``DataInterface.h`` of Multicore Bundle Adjustment,
http://grail.cs.washington.edu/projects/mcba.
"""

from __future__ import annotations

import logging
from collections.abc import Iterator
from dataclasses import replace
from functools import partial
from itertools import islice
from pathlib import Path, PurePosixPath

import numpy as np

from rigs.camera import Camera
from rigs.camera_protocol import CameraLike
from rigs.files.text import iter_lines, shortened
from rigs.formats._image_size import check_table_size, image_listed, required_size
from rigs.formats._radial_lens import radial_lens
from rigs.formats._values import (
    as_count,
    as_number,
    as_rotation,
    errors_of,
    errors_of_file,
    numbers_of_line,
)
from rigs.formats._views import Views
from rigs.geometry.image_checks import pixel_centres
from rigs.geometry.rotation import matrix_of_quaternion
from rigs.ray_table import RayTable
from rigs.rig import Rig

logger = logging.getLogger(__name__)

_HEADS = {"NVM_V3": 4, "NVM_V3_R9T": 9}  # and how many numbers turn a camera
_DIGITS = 18  # of a count that are read; a file of more lines than they count does not exist
_RADII = 1000  # between the middle of an image and its farthest corner, where a lens is fitted
_CLOSE_ENOUGH = 1e-3  # pixels: a tenth of what calibrations reach
_FIXED = ("fx", "cx", "fy", "cy")
_FIELDS = {
    "image_size": "image",
    "distortion": "k",
    "camera_matrix": "f",
    "R": "QW, QX, QY, QZ",
    "t": "Cx, Cy, Cz",
}


def looks_like(path: Path, head: str) -> bool:
    """Return whether ``head``, the file's first characters, is VisualSFM's."""
    return bool(head.split(maxsplit=1)) and head.split(maxsplit=1)[0] in _HEADS


def load(path: Path, image_size: tuple[int, int] | None = None) -> Rig:
    """Return the rig of a file's first model.

    Parameters
    ----------
    path : Path
    image_size : (int, int), optional
        Width and height of all images; by default those of the images themselves.

    Raises
    ------
    ValueError
        In one line: the file, the camera, the field, what was found, what was expected.
    """
    path = Path(path)
    with errors_of_file(path):
        lines = iter_lines(path)
        words = next(lines, "").split()
        if not words or words[0] not in _HEADS:
            raise ValueError(f"found {shortened(' '.join(words))}, expected NVM_V3")
        fixed = _fixed(words[1:])
        count = as_count(next(lines, None), "number of cameras")
        views = Views(path, _FIELDS)
        for line in islice(lines, count):
            image, camera, k = _image(line, _HEADS[words[0]], fixed, path.parent, image_size)
            views.add(str(image), camera, None, partial(_bent, k=k))
        if len(views.images) < count:
            raise ValueError(
                f"number of cameras: found {count} and {len(views.images)} lines of them"
            )
        _warn_of_others(path, lines)
        return views.rig()


def _fixed(words: list[str]) -> dict[str, float]:
    """Return the calibration common to all images, by its names; empty where there is none."""
    if not words:
        return {}
    if words[0] != "FixedK":
        raise ValueError(f"found {shortened(' '.join(words))}, expected FixedK fx cx fy cy")
    with errors_of("FixedK"):
        return dict(zip(_FIXED, numbers_of_line(words[1:], _FIXED), strict=True))


def _image(
    line: str,
    turns: int,
    fixed: dict[str, float],
    folder: Path,
    image_size: tuple[int, int] | None,
) -> tuple[PurePosixPath, Camera, float]:
    """Return the name of a line's image, its camera as a pinhole, and k."""
    names = ["f", *(f"R{i}" for i in range(turns)), "Cx", "Cy", "Cz", "k", "0"]
    words = line.split()
    if len(words) <= len(names):
        raise ValueError(f"found {shortened(line)}, expected an image's name, f, its pose, k, 0")
    name = " ".join(words[: -len(names)]).replace('"', " ")
    with errors_of(f"image {name}"):
        f, *pose, k, zero = numbers_of_line(words[-len(names) :], names)
        if zero != 0:
            raise ValueError(f"found {zero:g} at the end of its line, expected 0")
        if turns == 4:
            R = matrix_of_quaternion(pose[:4], "QW, QX, QY, QZ")
            t = -R @ pose[4:]
        else:
            R, t = as_rotation(np.reshape(pose[:9], (3, 3)), "R"), np.array(pose[9:])
        image, file = image_listed(folder, name)
        width, height = required_size(image_size, "NVM", file)
        if fixed and abs(f - fixed["fx"]) > 1e-6 * abs(f):
            raise ValueError(f"f: found {f}, expected {fixed['fx']} as in FixedK")
        fx, fy = (fixed.get(key, as_number(f, "f")) for key in ("fx", "fy"))
        cx, cy = fixed.get("cx", width / 2) - 0.5, fixed.get("cy", height / 2) - 0.5
        K = [[fx, 0.0, cx], [0.0, fy, cy], [0.0, 0.0, 1.0]]
        try:
            camera = Camera("entry", (width, height), K, R=R, t=t, status="calibrated")
        except ValueError as error:
            raise ValueError(str(error).removeprefix("camera entry: ")) from None
    return image, camera, k


def _bent(camera: Camera, k: float) -> CameraLike:
    """Return the camera whose images bend by k: with a lens fitted, whose error is logged.

    It is a table of rays, exact, where no lens fits.
    """
    if k == 0:
        return camera
    K, (width, height) = camera.camera_matrix, camera.image_size
    corners = np.array([[x, y] for x in (-0.5, width - 0.5) for y in (-0.5, height - 0.5)])
    farthest = np.linalg.norm((corners - K[:2, 2]) / np.diag(K)[:2], axis=1).max()
    radius = np.linspace(0, farthest, _RADII)
    lens, error = radial_lens(radius * (1 + k * radius**2), radius)
    error *= float(np.diag(K)[:2].max())
    if error < _CLOSE_ENOUGH:
        logger.warning(
            "camera %s: k: a lens of rig.yaml was fitted, to %.1g pixels", camera.name, error
        )
        return replace(camera, distortion=lens)
    with errors_of(f"camera {camera.name}"):
        check_table_size(camera.image_size)
    plane = (pixel_centres(camera.image_size) - K[:2, 2]) / np.diag(K)[:2]
    q = np.sum(plane**2, axis=1, keepdims=True)
    straight = np.where(1 + 3 * k * q > 0, plane * (1 + k * q), np.nan)  # before the fold
    seen = np.hstack([straight, np.ones((len(plane), 1))]) @ camera.R
    rows = seen.reshape(*camera.image_size[::-1], 3)
    return RayTable(camera.name, camera.position, rows, status="calibrated")


def _warn_of_others(path: Path, lines: Iterator[str]) -> None:
    """Log whether further models follow the first one's points."""
    points = next(lines, "0").split()
    count = int(points[0][:_DIGITS]) if points[0].isascii() and points[0].isdigit() else 0
    more = next(islice(lines, count, None), "0").split()[0]
    if more.isascii() and more.strip("0").isdigit():
        logger.warning("%s: a further model, of %s images, is left out", path, more[:_DIGITS])
