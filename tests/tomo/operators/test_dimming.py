"""The change of images by more extinction: the derivative of Beer and Lambert's law."""

from dataclasses import replace

import numpy as np
import pytest

import rigs
from rigs.scene.gas import ExtinctionVolume
from tomo.grid import ActiveVoxels, VoxelGrid
from tomo.operators import Absorption, LinearSystem, Projector, dot_test
from tomo.operators.absorption import attenuating, dimmed
from tomo.rays import Rays
from tomo.trace import trace

RNG = np.random.default_rng(0)
GRID = VoxelGrid((9, 8, 10), (1.0, 1.2, 0.9), (3.0, -2.0, 1.0))
LIGHT = RNG.random(GRID.size)
SMOKE = 0.2 * RNG.random(GRID.shape)
AROUND = ExtinctionVolume(0.1 * RNG.random((4, 5, 3)), GRID.lower - [4, 2, 3], (4.0, 3.0, 5.0))
GASES = {
    "clear": Absorption(),
    "own": Absorption(0.05, 0.1),
    "smoke": Absorption(0.05, 0.0, ExtinctionVolume(SMOKE, GRID.lower, GRID.spacing)),
    "around": Absorption(extinction=AROUND),
}


def paths(weight=1.0):
    """Return paths of two pieces each: in through the grid, and back through it elsewhere."""
    origins = GRID.center + 40 * np.array([[1.0, 0.2, -0.3], [-0.4, 1, 0.2], [0.1, -0.3, -1]])
    there = np.asarray(GRID.center) + RNG.uniform(-2, 2, (3, 3)) - origins
    far = origins + 2 * there
    back = np.asarray(GRID.center) + RNG.uniform(-2, 2, (3, 3)) - far
    starts = np.stack([origins, far], axis=1).reshape(-1, 3)
    ways = np.stack([there, back], axis=1).reshape(-1, 3)
    lengths = np.stack([2 * np.linalg.norm(there, axis=1), np.full(3, np.inf)], axis=1).ravel()
    rays = Rays.from_lines(starts, ways, lengths)
    ptr = np.array([0, 2, 4, 6])
    return replace(rays, pixel_ptr=ptr, path_ptr=ptr, weight=np.full(6, weight))


def change_by(rays, gas, emission):
    return Projector(dimmed(GRID, gas, LIGHT, emission)(rays), GRID)


@pytest.mark.parametrize("weight", [1.0, 0.3])
@pytest.mark.parametrize("name", ["clear", "own", "smoke"])
def test_it_is_the_derivative_of_what_is_seen(name, weight):
    rays, gas, step = paths(weight), GASES[name], 0.02
    emission = LIGHT if gas.emission else None
    found = change_by(rays, gas, emission) @ np.eye(GRID.size)[:, ::37]
    known = np.zeros(GRID.shape) if gas.extinction is None else gas.extinction.values

    def seen(more):
        both = ExtinctionVolume(known + more.reshape(GRID.shape), GRID.lower, GRID.spacing)
        traced = attenuating(GRID, replace(gas, extinction=both), emission)(rays)
        return Projector(traced, GRID) @ LIGHT

    given = seen(np.zeros(GRID.size))
    for column, change in zip(found.T, step * np.eye(GRID.size)[::37], strict=True):
        np.testing.assert_allclose(column * step, seen(change) - given, rtol=0.03, atol=2e-6)


def test_gas_before_the_grid_dims_all_that_gas_in_it_would_change():
    whole = paths()
    rays = Rays.from_lines(whole.origins[::2], whole.directions[::2])
    means = AROUND.means(GRID.lower, GRID.spacing, GRID.shape)
    inside = ExtinctionVolume(means, GRID.lower, GRID.spacing)
    found = change_by(rays, GASES["around"], None) @ np.eye(GRID.size)
    within = change_by(rays, Absorption(extinction=inside), None) @ np.eye(GRID.size)
    left = found.sum(axis=1) / within.sum(axis=1)  # the fraction of all light
    np.testing.assert_allclose(found, left[:, None] * within, rtol=1e-4, atol=1e-6)
    assert (left < 0.99).any()


def test_entries_are_those_of_a_slow_sum():
    """Minus the way through a voxel, times the light from behind it and half of its own."""
    rays, k = paths(), 0.05
    segments = trace(replace(rays, pixel_ptr=np.arange(7), path_ptr=None), GRID, dtype=np.float64)
    expected = np.zeros((3, GRID.size))
    for path in range(3):
        some = slice(segments.ptr[2 * path], segments.ptr[2 * path + 2])
        voxel, way = segments.voxel[some], segments.length[some]
        depth = k * np.cumsum(way) - k * way / 2
        arriving = LIGHT[voxel] * way * np.exp(-depth)
        for n, own in enumerate(voxel):
            behind = arriving[n + 1 :].sum() + arriving[n] / 2
            expected[path, own] -= way[n] * behind
    found = change_by(rays, Absorption(medium=k), None) @ np.eye(GRID.size)
    np.testing.assert_allclose(found, expected, rtol=2e-5, atol=1e-6)


@pytest.mark.parametrize("basis", ["voxel", "linear"])
def test_a_system_has_the_change_in_its_basis_and_the_adjoint(basis):
    rig = rigs.ring(3, distance=400.0, image_size=(26, 24), footprint=0.55, center=GRID.center)
    some = ActiveVoxels.from_mask(GRID, RNG.random(GRID.shape) < 0.6)
    system = LinearSystem.from_rig(rig, GRID, active=some, skip=False, form="stored")
    system = system.with_linear_basis() if basis == "linear" else system
    light, gas = some.compress(LIGHT), GASES["smoke"]
    found = system.dimming(gas, light)
    assert found.shape == (system.projector.shape[0], GRID.size)
    assert dot_test(found) < 1e-12
    assert dot_test(found, dtype=np.float32) < 1e-6
    thicker = ExtinctionVolume(SMOKE + 1e-3, GRID.lower, GRID.spacing)
    more = system.with_absorption(replace(gas, extinction=thicker)).projector @ light
    less = system.with_absorption(gas).projector @ light
    expected = (more - less) / 1e-3
    error = np.linalg.norm(found @ np.ones(GRID.size) - expected)
    assert error < 0.01 * np.linalg.norm(expected)
