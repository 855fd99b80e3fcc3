"""3-D Gaussian splatting's ``cameras.json``: pinholes with the principal point in the middle.

A list of ``{id, img_name, width, height, position, rotation, fx, fy}``: ``rotation``
is *camera to world*, its columns OpenCV's axes (x right, y down, z forward), ``position`` the
camera's centre. The renderer knows neither a lens nor a principal point: the axis meets the image
in its middle, at pixel ``(width - 1) / 2``, ``(height - 1) / 2`` with pixel centres at integers.
Lens values, which some forks write without saying in which convention, are refused.
Source: ``camera_to_JSON`` in ``utils/camera_utils.py`` and ``ndc2Pix`` of the rasteriser at
https://github.com/graphdeco-inria/gaussian-splatting.
"""

from __future__ import annotations

import re
from pathlib import Path

from rigs.camera import Camera
from rigs.files.text import read_json, shortened
from rigs.formats._values import (
    as_array,
    as_count,
    as_mapping,
    as_number,
    as_rotation,
    errors_of,
    required,
)
from rigs.formats._views import Views
from rigs.rig import Rig

_FOREIGN = re.compile(r"c[xy]|[kp]\d|skew|.*(?:dist|principal|model).*", re.IGNORECASE)


def looks_like(path: Path, head: str) -> bool:
    """Return whether a file is a list of entries with ``img_name`` and ``rotation``."""
    return (
        path.suffix == ".json"
        and head.lstrip().startswith("[")
        and all(f'"{key}"' in head for key in ("img_name", "rotation", "position"))
    )


def load(path: Path, image_size: tuple[int, int] | None = None) -> Rig:
    """Return the rig of a ``cameras.json``."""
    data = read_json(path)
    if not isinstance(data, list) or not data:
        raise ValueError(f"found {shortened(data)}, expected a list of cameras")
    views = Views(path)
    for index, entry in enumerate(data):
        views.add(*_view(index, entry))
    return views.rig()


def _view(index: int, entry: object) -> tuple[str, Camera]:
    """Return an entry's image and its camera under a placeholder name."""
    with errors_of(f"[{index}]"):
        entry = as_mapping(entry, "entry")
        name = entry.get("img_name")
        if not isinstance(name, str) or not name.strip():
            raise ValueError(f"img_name: found {shortened(name)}, expected an image's name")
    with errors_of(f"camera {name}"):
        for key in filter(_FOREIGN.fullmatch, entry):
            raise ValueError(
                f"{key}: found {shortened(entry[key])}, expected none, as the format has no lens "
                "and its axis is the middle: convert the COLMAP model or transforms.json that "
                "the splats were trained on"
            )
        fx, fy = (as_number(required(entry, key), key) for key in ("fx", "fy"))
        width, height = (as_count(required(entry, key), key) for key in ("width", "height"))
        R = as_rotation(required(entry, "rotation"), "rotation").T
        position = as_array(required(entry, "position"), (3,), "position")
        K = [[fx, 0.0, (width - 1) / 2], [0.0, fy, (height - 1) / 2], [0.0, 0.0, 1.0]]
        camera = Camera("camera", (width, height), K, R=R, t=-R @ position, status="calibrated")
    return name, camera
