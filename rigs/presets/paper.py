"""The camera layouts of the WERNet paper, and how their preset files are made.

The flame stands along y in 30 x 140 x 30 voxels of 0.5 mm. All cameras have one lens: a pixel is
half a voxel, 0.25 mm, at the flame from 5800 mm. 33 views every 11 degrees make 363 degrees, as
in the paper, so the last view is 8 degrees from the first.

The files in ``presets`` are made by ``write_presets``::

    python -c "import rigs.presets.paper; rigs.presets.paper.write_presets('rigs/presets')"
"""

from __future__ import annotations

import os
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from rigs.files.rig_yaml import FORMAT, VERSION
from rigs.files.text import write_text
from rigs.layouts import UP, circle_positions, image_size_for, look_inward
from rigs.rig import Rig, Volume

VOLUME = Volume((30, 140, 30), 0.5)
DISTANCE = 5800.0
FOCAL_LENGTH = 116.0
PIXEL_PITCH = 0.005
WORLD_FRAME = "origin in the middle of the volume, y up along the flame, cam00 on the +z side"
SEED = 2024

_TITLES = {
    "paper33_level": "33 views every 11 degrees, level, at 5800 mm",
    "paper33_pitch": "33 views every 11 degrees, pitched +15 and -15 degrees in turn, at 5800 mm",
    "paper33_random": "33 views every 11 degrees, level, at random distances 5500 to 6500 mm",
    "paper11_11deg": "11 views every 11 degrees, level, at 5800 mm",
    "paper11_22deg": "11 views every 22 degrees, level, at 5800 mm",
    "paper11_33deg": "11 views every 33 degrees, level, at 5800 mm",
}


def paper_layout_names() -> tuple[str, ...]:
    """Return the names that `paper_layout` knows."""
    return tuple(_TITLES)


def paper_layout(name: str) -> Rig:
    """Return one of the paper's layouts; `rigs.preset` reads the same from its file."""
    if name not in _TITLES:
        raise ValueError(f"layout: found {name!r}, expected one of {', '.join(_TITLES)}")
    lens = {"focal_length": FOCAL_LENGTH, "pixel_pitch": PIXEL_PITCH, "volume": VOLUME}
    rig = look_inward(_positions(name), image_size=(1, 1), **lens)
    size = image_size_for(VOLUME, rig)
    rig = look_inward(_positions(name), image_size=size, **lens)
    return replace(rig, world_frame=WORLD_FRAME)


def paper_layout_yaml(name: str) -> str:
    """Return the text of a preset's file: where each camera stands, in millimetres."""
    rig = paper_layout(name)
    lines = [
        f"# {_TITLES[name]}.",
        "# Made by rigs.presets.paper.write_presets.",
        f"format: {FORMAT}",
        f"version: {VERSION}",
        "length_unit: mm",
        "convention: opencv",
        f"world_frame: {WORLD_FRAME}",
        "volume:",
        f"  shape: {list(VOLUME.shape)}",
        f"  spacing: {list(VOLUME.spacing)}",
        f"  center: {list(VOLUME.center)}",
        "cameras:",
    ]
    for camera, position in zip(rig, _positions(name).tolist(), strict=True):
        lines += [
            f"  - name: {camera.name}",
            f"    image_size: {list(camera.image_size)}",
            f"    focal_length: {FOCAL_LENGTH}",
            f"    pixel_pitch: {PIXEL_PITCH}",
            f"    position: {position}",
            "    look_at: [0.0, 0.0, 0.0]",
            f"    up: {list(UP)}",
            "    status: virtual",
        ]
    return "\n".join(lines) + "\n"


def write_presets(folder: str | os.PathLike) -> None:
    """Write every layout's file into ``folder``."""
    for name in _TITLES:
        write_text(Path(folder) / f"{name}.yaml", paper_layout_yaml(name))


def _positions(name: str) -> NDArray[np.float64]:
    """Return where the cameras stand, ``(views, 3)``, rounded to 1e-6 mm to keep files short."""
    count = int(name[5:7])
    distance, pitch, step = DISTANCE, 0.0, 11.0
    if name == "paper33_pitch":
        pitch = np.where(np.arange(count) % 2 == 0, 15.0, -15.0)
    elif name == "paper33_random":
        distance = np.random.default_rng(SEED).uniform(5500.0, 6500.0, count)
    elif name.endswith("deg"):
        step = float(name[8:10])
    positions = circle_positions(count, step, distance, pitch_degrees=pitch)
    return np.round(positions, 6) + 0.0  # no negative zeros
