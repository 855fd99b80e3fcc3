"""Pix4D's ``*_calibrated_camera_parameters.txt``.

Read only. After a head of names, ten lines an image: its name and size; the camera matrix, three
lines; radial distortion k1 k2 k3; tangential distortion, OpenCV's p1 p2; the camera's position t;
and the rotation R, three lines, with ``m = K [R | -R t] X``, OpenCV's axes. The image's corner is
(0, 0), its pixels' centres are at halves. Lengths are in the unit of Pix4D's local system, which
the file does not name, and from its offset. Sources: the file's own head; "How are the internal
and external camera parameters defined" at https://support.pix4d.com.
"""

from __future__ import annotations

from itertools import islice
from pathlib import Path

import numpy as np

from rigs.camera import Camera
from rigs.files.text import read_text, shortened
from rigs.formats._lens import from_vector
from rigs.formats._values import as_array, as_count, as_rotation, errors_of
from rigs.formats._views import Views
from rigs.rig import Rig

_HEAD = "fileName imageWidth imageHeight"


def looks_like(path: Path, head: str) -> bool:
    """Return whether a file begins with Pix4D's names."""
    return head.startswith(_HEAD) and "camera matrix K" in head


def load(path: Path, image_size: tuple[int, int] | None = None) -> Rig:
    """Return the rig of a ``*_calibrated_camera_parameters.txt``."""
    lines = [line.strip() for line in read_text(path).splitlines() if line.strip()]
    start = next((i for i, line in enumerate(lines) if line.startswith("camera model")), None)
    if start is None:
        raise ValueError("camera model: missing, expected it as the last line of the head")
    views, rest = Views(path), iter(lines[start + 1 :])
    for first in rest:
        name, *size = first.rsplit(maxsplit=2)
        with errors_of(f"image {name}"):
            views.add(name, _camera(size, list(islice(rest, 9))))
    return views.rig()


def _camera(size: list[str], lines: list[str]) -> Camera:
    """Return the camera of an image's lines, under a placeholder name."""
    if len(size) != 2 or len(lines) != 9:
        raise ValueError(f"found {shortened(size)}, {len(lines)} lines, expected a size and nine")
    width, height = (as_count(word, "imageWidth, imageHeight") for word in size)
    words = [line.split() for line in lines]
    K = np.array(as_array(words[:3], (3, 3), "camera matrix K"))
    K[:2, 2] -= 0.5
    k1, k2, k3 = as_array(words[3], (3,), "radial distortion")
    p1, p2 = as_array(words[4], (2,), "tangential distortion")
    position = as_array(words[5], (3,), "camera position t")
    R = as_rotation(words[6:], "camera rotation R")
    lens = from_vector([k1, k2, p1, p2, k3], False, "distortion")
    return Camera("image", (width, height), K, lens, R, -R @ position, status="calibrated")
