"""Gas in a scene: behind a window, in a rig's file, in the operators."""

import dataclasses

import numpy as np
import pytest

from rigs import Camera, Rig, Volume, load_rig, look_at, save_rig
from rigs.scene import Glass, Scene, SceneCamera, Window
from rigs.scene.gas import ExtinctionVolume, Gas, IndexVolume
from rigs.scene.tracing import OPEN
from tomo.grid import VoxelGrid
from tomo.operators.system import LinearSystem
from tomo.rays import Rays

PANE = Window("pane", (0, 0, 60), (0.3, 0.1, 1), 10, Glass("quartz"), size=60)


def hot_air(height=2e-4):
    """A column of gas, thinner in its middle."""
    axis = (np.arange(20) + 0.5) * 2 - 20
    x, y, z = np.meshgrid(axis, axis, axis, indexing="ij")
    bell = np.exp(-(x**2 + z**2) / 50) * np.cos(np.pi * y / 40) ** 2
    return IndexVolume(1 + height - height * bell, (-20, -20, -20), 2.0, 1 + height)


def scene(height=2e-4, gas=None):
    return Scene((PANE,), 1 + height, gas=gas or Gas(hot_air(height)))


def camera(position=(0.0, 10, 300), name="cam00"):
    R, t = look_at(position, (0, 0, 0))
    return Camera(name, (40, 32), [[500, 0, 19.5], [0, 500, 15.5], [0, 0, 1]], R=R, t=t)


def rays(count=100):
    rng = np.random.default_rng(0)
    origins = np.tile([0.0, 10, 300], (count, 1))
    towards = rng.uniform(-12, 12, (count, 3)) - origins
    return origins, towards / np.linalg.norm(towards, axis=1, keepdims=True)


def test_gas_of_the_medium_s_index_bends_nothing():
    even = Gas(IndexVolume(np.full((4, 4, 4), 1.0), (-20, -20, -20), 10.0, 1.0))
    bent = Scene((PANE,), gas=even).paths(*rays())
    plain = Scene((PANE,)).paths(*rays())
    for paths in (bent, plain):
        assert (paths.ends == OPEN).all()
    last = [paths.ray_ptr[1:] - 1 for paths in (bent, plain)]
    np.testing.assert_allclose(bent.directions[last[0]], plain.directions[last[1]], atol=1e-12)
    away = bent.origins[last[0]] - plain.origins[last[1]]
    assert np.abs(np.cross(away, plain.directions[last[1]])).max() < 1e-9


def test_pieces_join_from_the_camera_through_glass_and_gas_and_back():
    found = scene(0.02).paths(*rays())
    ends = found.origins + found.lengths[:, None] * found.directions
    inner = np.setdiff1d(np.arange(len(found.lengths)), found.ray_ptr[1:] - 1)
    np.testing.assert_allclose(found.origins[inner + 1], ends[inner], atol=1e-9)
    last = found.ray_ptr[1:] - 1
    straight = Scene((PANE,), 1.02).paths(*rays())
    turned = found.directions[last] - straight.directions[straight.ray_ptr[1:] - 1]
    assert np.linalg.norm(turned, axis=1).max() > 1e-3
    back = scene(0.02).paths(
        found.origins[last] + 100 * found.directions[last], -found.directions[last]
    )
    home = back.ray_ptr[1:] - 1
    missed = np.cross(rays()[0] - back.origins[home], back.directions[home])
    assert np.abs(missed).max() < 1e-9 * 500


def test_the_pixel_of_a_point_in_gas_looks_at_the_point():
    seen = SceneCamera(camera(), scene(0.01))
    points = np.random.default_rng(1).uniform(-8, 8, (40, 3))
    uv, _, valid = seen.project(points)
    assert valid.all()
    paths, _ = seen.paths(uv)
    piece = paths.nearest_pieces(points)
    away = points - paths.origins[piece]
    missed = np.linalg.norm(np.cross(away, paths.directions[piece]), axis=1)
    assert missed.max() < 0.02  # pieces are within a hundredth of a voxel of 2 from the path


def test_a_rig_with_gas_comes_back_from_its_file(tmp_path):
    gas = Gas(hot_air(), ExtinctionVolume(np.full((2, 3, 4), 0.01), (-10, -10, -10), 5.0))
    rig = Rig((camera(),), volume=Volume((10, 10, 10), 1.5)).through(scene(gas=gas))
    save_rig(rig, tmp_path / "rig.yaml")
    assert load_rig(tmp_path / "rig.yaml") == rig
    quarter = np.array([[0.0, 0, 1], [0, 1, 0], [-1, 0, 0]])
    turned = rig.transformed(quarter, np.array([1.0, 2, 3]))
    point = np.array([[3.0, -4, 5]])
    there = point @ quarter.T + [1, 2, 3]
    np.testing.assert_allclose(turned[0].project(there)[0], rig[0].project(point)[0], atol=1e-6)
    with pytest.raises(ValueError, match="quarter turns"):
        rig.transformed(look_at((1.0, 2, 3), (0, 0, 0))[0], np.zeros(3))


def test_a_window_in_the_gas_is_refused():
    with pytest.raises(ValueError, match="solid pane: reaches into the box"):
        Scene((dataclasses.replace(PANE, point=(0, 0, 15)),), 1 + 2e-4, gas=Gas(hot_air()))


def test_constant_emission_in_bent_rays_adds_up_to_the_length_of_the_path():
    grid = VoxelGrid((20, 20, 20), 2.0)
    rig = Rig((camera(),)).through(scene(0.02))
    ones = np.ones(grid.size, np.float32)
    for form in ("stored", "on-the-fly"):
        system = LinearSystem.from_rig(rig, grid, form=form)
        found = system.images(system.projector @ ones)[0]
        pieces = Rays.from_camera(rig[0], grid=grid)
        inside = np.zeros(pieces.n_pixels)
        middles = pieces.origins + np.minimum(pieces.lengths, 1e4)[:, None] * pieces.directions / 2
        in_box = (np.abs(middles) < 20 + 1e-9).all(axis=1) & np.isfinite(pieces.lengths)
        np.add.at(
            inside,
            np.repeat(np.arange(pieces.n_pixels), np.diff(pieces.pixel_ptr)),
            np.where(in_box, pieces.lengths, 0),
        )
        np.testing.assert_allclose(found.ravel(), inside, atol=1e-4)
