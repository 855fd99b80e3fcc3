"""Gas that absorbs along paths of several pieces, and gas whose extinction is given."""

from dataclasses import replace

import numpy as np
import pytest

import rigs
from rigs.scene.gas import ExtinctionVolume, IndexVolume
from tomo.grid import ActiveVoxels, VoxelGrid
from tomo.operators import Absorption, LinearSystem, Projector, dot_test
from tomo.operators.absorption import attenuating
from tomo.operators.on_the_fly import AttenuatedProjector, OnTheFlyProjector
from tomo.rays import Rays
from tomo.trace import TRACERS, trace

RNG = np.random.default_rng(0)
GRID = VoxelGrid((9, 8, 10), (1.0, 1.2, 0.9), (3.0, -2.0, 1.0))
EMISSION = RNG.random(GRID.shape)
SOME = ActiveVoxels.from_mask(GRID, RNG.random(GRID.shape) < 0.6)
SMOKE = ExtinctionVolume(0.2 * RNG.random(GRID.shape), GRID.lower, GRID.spacing)
AROUND = ExtinctionVolume(0.1 * RNG.random((4, 5, 3)), GRID.lower - [4, 2, 3], (4.0, 3.0, 5.0))
GASES = {
    "medium": Absorption(medium=0.1),
    "own": Absorption(emission=0.2),
    "smoke": Absorption(extinction=SMOKE),
    "around": Absorption(extinction=AROUND),
    "all": Absorption(0.05, 0.1, AROUND),
}


def lines(count, seed=1):
    rng = np.random.default_rng(seed)
    origins = rng.normal(size=(count, 3))
    origins = GRID.center + 40 * origins / np.linalg.norm(origins, axis=1, keepdims=True)
    return Rays.from_lines(origins, GRID.center + rng.uniform(-3, 3, (count, 3)) - origins)


def in_pieces(rays, seed=2):
    """Return straight rays as paths of several pieces, cut at faces of voxels and before them."""
    rng, parts = np.random.default_rng(seed), []
    segments = trace(rays, GRID, dtype=np.float64, midpoints=True)
    for ray in range(len(rays)):
        some = slice(*segments.ptr[ray : ray + 2])
        middles = segments.midpoint[some] + np.asarray(GRID.center) - rays.origins[ray]
        faces = middles @ rays.directions[ray] + segments.length[some] / 2
        cuts = np.sort(rng.choice(faces[:-1], 3, replace=False)) if len(faces) > 3 else []
        cuts = np.concatenate([[0, 20.0], cuts])
        lengths = np.append(np.diff(cuts), np.inf)
        starts = rays.origins[ray] + cuts[:, None] * rays.directions[ray]
        parts.append(Rays.from_lines(starts, rays.directions[ray], lengths))
    whole = Rays.concatenate(parts)
    ptr = np.cumsum([0] + [len(part) for part in parts])
    return replace(whole, pixel_ptr=ptr, path_ptr=ptr)


LINES = lines(20)
PATHS = in_pieces(LINES)


def stored(rays, gas, active=None):
    emission = None if active is None else active.compress(EMISSION)
    traced = attenuating(
        GRID, gas, EMISSION.ravel() if active is None else emission, active=active
    )(rays)
    return Projector(traced, GRID, active=active)


@pytest.mark.parametrize("gas", GASES.values(), ids=GASES)
def test_a_ray_cut_into_pieces_is_seen_through_as_much_gas(gas):
    whole, cut = stored(LINES, gas), stored(PATHS, gas)
    np.testing.assert_allclose(cut.row_sums, whole.row_sums, rtol=2e-5)
    x = EMISSION.ravel()
    np.testing.assert_allclose(cut @ x, whole @ x, rtol=2e-5)
    apart = stored(replace(PATHS, path_ptr=None), gas)
    assert (apart.row_sums > 1.02 * cut.row_sums).mean() > 0.9  # each piece a path by itself


@pytest.mark.parametrize("gas", GASES.values(), ids=GASES)
@pytest.mark.parametrize("active", [None, SOME], ids=["all", "some"])
def test_paths_on_the_fly_are_those_stored_and_have_their_adjoint(gas, active):
    rays = PATHS
    emission = EMISSION.ravel() if active is None else active.compress(EMISSION)
    fly = AttenuatedProjector(OnTheFlyProjector(rays, GRID, active=active), gas, emission)
    x = np.random.default_rng(3).random(fly.shape[1])
    np.testing.assert_allclose(fly @ x, stored(rays, gas, active) @ x, rtol=1e-5)
    some = np.array([3, 7, 15])
    np.testing.assert_allclose(fly.take(some) @ x, (fly @ x)[some], rtol=1e-6)
    for operator in (fly, stored(rays, gas, active)):
        assert dot_test(operator, dtype=np.float64) < 1e-12
        assert dot_test(operator, dtype=np.float32) < 1e-6


def test_a_mirrored_path_is_dimmed_by_all_of_its_way_in_the_grid():
    grid, k = VoxelGrid((200, 2, 2), (0.05, 5.0, 5.0)), 0.3
    # in along x, out at the far end, back below: 10 and 10 of way in the grid, 7 outside
    there = Rays.from_lines([[-8.0, 2, 2], [6, 2, 2], [6, -2, 2]],
                            [[1.0, 0, 0], [0, -1, 0], [-1, 0, 0]], [14.0, 4, np.inf])  # fmt: skip
    path = replace(there, pixel_ptr=np.array([0, 3]), path_ptr=np.array([0, 3]))
    found = attenuating(grid, Absorption(medium=k))(path)
    np.testing.assert_allclose(found.length.sum(), -np.expm1(-20 * k) / k, rtol=1e-4)
    front = found.voxel % 4 == 3  # the row of voxels at y, z > 0, which is seen first
    np.testing.assert_allclose(found.length[front].sum(), -np.expm1(-10 * k) / k, rtol=1e-4)


def test_even_extinction_is_the_medium_and_one_by_emission_is_the_gas_its_own():
    rays = PATHS
    even = ExtinctionVolume(np.full(GRID.shape, 0.1), GRID.lower, GRID.spacing)
    own = ExtinctionVolume(0.2 * EMISSION, GRID.lower, GRID.spacing)
    for extinction, same in ((even, "medium"), (own, "own")):
        found = stored(rays, Absorption(extinction=extinction))
        np.testing.assert_allclose(found.row_sums, stored(rays, GASES[same]).row_sums, rtol=2e-5)


def test_weights_of_pieces_change_no_depth():
    rays = PATHS
    lighter = replace(rays, weight=np.full(len(rays), 0.3))
    for gas in GASES.values():
        expected = 0.3 * stored(rays, gas).row_sums
        np.testing.assert_allclose(stored(lighter, gas).row_sums, expected, rtol=2e-5)


def test_gas_in_voxels_that_are_not_active_absorbs():
    rays, gas = PATHS, GASES["all"]
    emission = SOME.expand(SOME.compress(EMISSION))
    whole = Projector(attenuating(GRID, gas, emission.ravel())(rays), GRID)
    some = stored(rays, gas, SOME)
    x = np.random.default_rng(4).random(SOME.size)
    np.testing.assert_allclose(some @ x, whole @ SOME.expand(x), rtol=1e-5)


def test_gas_before_the_grid_dims_all_of_it():
    thick, k = 6.0, 0.25
    wall = ExtinctionVolume([[[k]]], GRID.lower - [thick, 9, 9], (thick, 40, 40))
    rays = Rays.from_lines([[-60.0, -2, 1]], [[1.0, 0, 0]])
    clear = trace(rays, GRID)
    before = attenuating(GRID, Absorption(extinction=wall))(rays)
    np.testing.assert_allclose(before.length, np.exp(-k * thick) * clear.length, rtol=1e-6)
    back = Rays.from_lines([[60.0, -2, 1]], [[-1.0, 0, 0]])
    behind = attenuating(GRID, Absorption(extinction=wall))(back)
    np.testing.assert_allclose(behind.length, trace(back, GRID).length, rtol=1e-6)


@pytest.mark.parametrize("form", ["stored", "on-the-fly"])
def test_a_system_of_cameras_sees_through_given_gas(form):
    rig = rigs.ring(3, distance=400.0, image_size=(26, 24), footprint=0.55, center=GRID.center)
    how = {"form": form, "active": SOME, "skip": False}
    system = LinearSystem.from_rig(rig, GRID, **how).with_absorption(GASES["smoke"])
    camera = Rays.from_camera(rig[1], np.arange(26 * 24))
    found = system.projector.view(1) @ np.ones(SOME.size, np.float32)
    np.testing.assert_allclose(found, stored(camera, GASES["smoke"], SOME).row_sums, rtol=1e-5)


@pytest.mark.parametrize("tracer", TRACERS)
def test_pieces_of_bent_rays_add_up_to_their_way(tracer):
    rng = np.random.default_rng(5)
    grid = VoxelGrid((12, 10, 11), (0.5, 0.6, 0.55))
    gas = IndexVolume(1 + 0.2 * rng.random((6, 6, 6)), grid.lower, grid.extent / 6)
    origins = rng.normal(size=(20, 3))
    origins *= 20 / np.linalg.norm(origins, axis=1, keepdims=True)
    bent = gas.cross(origins, rng.uniform(-2, 2, (20, 3)) - origins)
    ptr = bent.ptr
    assert (np.diff(ptr) > 3).all()
    rays = Rays(bent.origins, bent.directions, bent.lengths, np.ones(len(bent)), ptr, ptr)
    segments = trace(rays, grid, tracer, dtype=np.float64)
    inside = np.add.reduceat(segments.length, segments.ptr[:-1])
    np.testing.assert_allclose(inside, np.add.reduceat(bent.lengths, ptr[:-1]), rtol=1e-10)
