"""RealityCapture's and RealityScan's CSV of internal and external camera parameters.

Read only. A line an image, under ``#name,x,y,alt,heading,pitch,roll,f,px,py,k1,k2,k3,k4,t1,t2``,
of which lens and principal point may be absent. The camera stands at ``x, y, alt``; its axes (x
right, y up, z backwards) are turned by ``Rz(-heading) Rx(pitch) Ry(roll)``, in degrees. ``f`` is
for a film 36 mm wide, the longer side of the image; ``px, py`` are in units of it from the image's
middle. The lens is OpenCV's, with k4 of the eighth power, by which the camera becomes a table of
rays. (0.5, 0.5) is the centre of the top-left pixel. Image sizes are those of the images, else
asked for; there is no unit. Sources: RealityCapture's help, "XMP camera math"; the importer
``realitycapture_utils.py`` at https://github.com/nerfstudio-project/nerfstudio.
"""

from __future__ import annotations

import csv
from collections.abc import Mapping
from functools import partial
from pathlib import Path

import numpy as np

from rigs.camera import Camera
from rigs.files.text import read_text
from rigs.formats._lens import from_vector, metashape_table
from rigs.formats._values import as_number, errors_of, image_listed, required, required_size
from rigs.formats._views import Views
from rigs.geometry.rotation import matrix_of_angles
from rigs.rig import Rig

_POSE = ("x", "y", "alt", "heading", "pitch", "roll", "f")


def looks_like(path: Path, head: str) -> bool:
    """Return whether a file's first line names the columns of poses."""
    return {"#name", *_POSE} <= set(head.partition("\n")[0].lower().replace(" ", "").split(","))


def load(path: Path, image_size: tuple[int, int] | None = None) -> Rig:
    """Return the rig of a CSV."""
    lines = read_text(path).splitlines()
    keys = lines[0].lower().replace(" ", "").split(",") if lines else []
    views = Views(path)
    for row in csv.reader(line for line in lines[1:] if line.strip()):
        if len(row) != len(keys):
            raise ValueError(f"found a line of {len(row)} values, expected {len(keys)}")
        entry = dict(zip(keys, row, strict=True))
        name = required(entry, "#name")
        with errors_of(f"image {name}"):
            _, file = image_listed(path.parent, name)
            size = required_size(image_size, "RealityCapture's", file)
            lens = {key: _number(entry, key, 0.0) for key in ("k1", "k2", "k3", "k4")}
            p1, p2 = (_number(entry, key, 0.0) for key in ("t1", "t2"))
            camera = _camera(entry, size, (*lens.values(), p1, p2))
            if not lens["k4"]:
                views.add(name, camera)
                continue
            lens |= {"p1": p2, "p2": p1, "p3": 0.0, "p4": 0.0}  # Metashape's order
            views.add(name, camera, None, partial(metashape_table, lens=lens, is_fisheye=False))
    return views.rig()


def _camera(entry: Mapping[str, str], size: tuple[int, int], lens: tuple[float, ...]) -> Camera:
    """Return the camera of a line, without k4, under a placeholder name."""
    x, y, z, heading, pitch, roll, f = (_number(entry, key) for key in _POSE)
    turns = np.deg2rad([[0, 0, -heading], [pitch, 0, 0], [0, roll, 0]])
    about_z, about_x, about_y = (matrix_of_angles(*turn) for turn in turns)
    R = np.diag([1.0, -1.0, -1.0]) @ (about_z @ about_x @ about_y).T
    longer = max(size)
    cx, cy = (
        _number(entry, key, 0.0) * longer + side / 2 - 0.5
        for key, side in zip(("px", "py"), size, strict=True)
    )
    k1, k2, k3, _, p1, p2 = lens
    distortion = from_vector([k1, k2, p1, p2, k3], False, "k1 ... t2")
    fx = f * longer / 36  # mm of film
    K = [[fx, 0.0, cx], [0.0, fx, cy], [0.0, 0.0, 1.0]]
    return Camera("line", size, K, distortion, R, -R @ [x, y, z], status="calibrated")


def _number(entry: Mapping[str, str], key: str, default: float | None = None) -> float:
    """Return the number of a column."""
    if default is not None and not entry.get(key, "").strip():
        return default
    return as_number(required(entry, key), key)
