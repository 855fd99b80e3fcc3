"""Errors of unit and convention stand first, before images are read."""

from dataclasses import replace

import numpy as np
import pytest

from rigs import ring
from rigs.check import scale_for
from tomo import Scan, VoxelGrid
from tomo.pipeline import Options
from tomo.pipeline.check_options import check_cameras

GRID = VoxelGrid((20, 30, 20), 1.0)
RIG = ring(5, distance=300.0, image_size=(60, 80), footprint=0.5)


def scan_of(cameras):
    rig = replace(RIG, cameras=tuple(cameras))
    return Scan.from_arrays(rig, {c.name: np.zeros((80, 60), np.float32) for c in rig}, GRID)


def in_metres(camera):
    return replace(camera, t=camera.t / 1000)


def test_a_right_rig_is_silent():
    assert check_cameras(scan_of(RIG), GRID, Options()) == []


def test_a_rig_in_metres_is_refused_unless_asked_for():
    scan = scan_of(map(in_metres, RIG))
    with pytest.raises(ValueError, match=r"all cameras: t seems to be in metres, .*check-rig"):
        check_cameras(scan, GRID, Options())
    (line,) = check_cameras(scan, GRID, Options(screen=False))
    assert "metres" in line


def test_one_camera_in_metres_is_named():
    first, *others = RIG
    scan = scan_of([in_metres(first), *others])
    (line,) = check_cameras(scan, GRID, Options(screen=False))
    assert line.startswith(f"camera {first.name}: t seems to be in metres")
    with pytest.raises(ValueError, match=r"cam00: found its position inside .*in metres"):
        check_cameras(scan, GRID, Options())


def test_images_may_be_shrunk_where_the_check_of_rigs_says_so():
    assert scale_for(RIG, GRID) is None
    pixels, scale = scale_for(RIG, VoxelGrid((4, 6, 4), 5.0))
    assert pixels == pytest.approx(10, rel=0.1)
    assert scale == 5


def test_a_camera_inside_the_grid_is_refused():
    """Its rays begin in the light: hours and gigabytes for no volume."""
    first, *others = RIG
    inside = replace(first, t=-first.R @ np.asarray(GRID.center))
    with pytest.raises(ValueError, match=f"camera {first.name}: found its position inside the gr"):
        check_cameras(scan_of([inside, *others]), GRID, Options())
