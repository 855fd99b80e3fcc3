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


def test_planes_stand_between_the_voxels_and_overhang():
    vertices, triangles = raycast.plane_quads((3, 2, 1))
    assert triangles.shape == (2 * 3, 3)
    corners = vertices[triangles].astype(float)  # (triangles, corners, 3)
    across = [np.flatnonzero(np.ptp(c, axis=0) == 0).tolist() for c in corners]
    assert across == [[0]] * 4 + [[1]] * 2
    assert corners[:4, 0, 0].tolist() == [-0.5, -0.5, 0.5, 0.5]
    assert corners[4:, 0, 1].tolist() == [0, 0]
    assert np.abs(corners[:4, :, 1]).min() > 1.0
    assert np.abs(corners[:4, :, 2]).min() > 0.5
    edges = corners[:2, 1:] - corners[:2, :1]  # of the two triangles of the first plane
    areas = np.linalg.norm(np.cross(edges[:, 0], edges[:, 1]), axis=1) / 2
    np.testing.assert_allclose(areas, (2 + 4) * (1 + 4) / 2)
