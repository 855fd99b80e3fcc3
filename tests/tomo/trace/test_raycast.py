"""That Open3D finds the crossings itself, and float64 repairs what single precision cannot."""

import logging

import numpy as np
import pytest

import rigs
from tomo.grid import VoxelGrid
from tomo.rays import Rays
from tomo.trace import raycast

GRID = VoxelGrid((30, 40, 20), (0.5, 0.4, 0.6), (3, 2, 1))


@pytest.fixture
def repaired(caplog):
    """Return a function that traces rays and returns how many were cut in float64 alone."""

    def count(rays, grid):
        caplog.set_level(logging.DEBUG, raycast.__name__)
        caplog.clear()
        raycast.trace(rays, grid)
        return sum(r.args[0] for r in caplog.records if r.name == raycast.__name__)

    return count


@pytest.mark.parametrize("distance", [0, 30, 1e4, 4e6])
def test_ordinary_rays_need_no_repair(repaired, distance):
    rng = np.random.default_rng(1)
    directions = rng.standard_normal((10_000, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    points = rng.uniform(GRID.lower, GRID.upper, (10_000, 3))
    rays = Rays.from_lines(points - distance * directions, directions)
    assert repaired(rays, GRID) < 0.01 * len(rays)


@pytest.mark.parametrize("name", rigs.preset_names())
def test_rays_of_the_presets_need_no_repair(repaired, name):
    rig = rigs.preset(name)
    grid = VoxelGrid(rig.volume.shape, rig.volume.spacing, rig.volume.center)
    rays = Rays.concatenate(
        Rays.from_camera(camera, np.arange(0, np.prod(camera.image_size), 101)) for camera in rig
    )
    assert repaired(rays, grid) < 0.01 * len(rays)


def test_rays_beside_planes_are_repaired(repaired):
    tilted = Rays.from_lines(GRID.lower + np.array([-9, 4.0, 3.0]), [1, 1e-9, 0])
    assert repaired(tilted, GRID) == 1


def test_work_in_blocks_is_the_work_at_once(monkeypatch):
    rng = np.random.default_rng(2)
    rays = Rays.from_lines(rng.normal(size=(100, 3)), rng.normal(size=(100, 3)))
    whole = raycast.trace(rays, GRID, midpoints=True)
    monkeypatch.setattr(raycast, "CUTS_AT_ONCE", 7 * sum(GRID.shape))
    blocks = raycast.trace(rays, GRID, midpoints=True)
    assert len(whole) > 1000
    for name in ("ptr", "voxel", "length", "midpoint"):
        np.testing.assert_array_equal(getattr(blocks, name), getattr(whole, name))
