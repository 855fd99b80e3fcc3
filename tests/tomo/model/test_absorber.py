"""A field of gas that absorbs: exact means, columns, units, words, and clouds that are found."""

from dataclasses import replace

import numpy as np
import pytest

import rigs
from phantoms import GaussianBlobs
from tomo.grid import VoxelGrid
from tomo.inference.fit import equations_of
from tomo.inference.infer import infer
from tomo.inference.solve import first_fit, next_fits, rises
from tomo.measurement import estimate_noise
from tomo.model import Absorber, Absorbing, Gain, Observation
from tomo.model.effect import Prediction
from tomo.operators import Absorption, dot_test, voxel_means

GRID = VoxelGrid((14, 18, 14), 1.0, (1.0, -2.0, 0.5))
FLAME = GaussianBlobs(
    np.array([[1.0, -1.0, -0.6], [-1.5, 2.0, 1.6], [0.6, -4.0, 1.2]]) + GRID.center,
    [2.0, 2.2, 1.8],
    [1.0, 0.8, 0.9],
)
RIG = rigs.ring(
    10, distance=200.0, image_size=(24, 30), footprint=0.9, pitch_degrees=[15.0, -10.0] * 5,
    start_degrees=11.0, center=GRID.center,
)  # fmt: skip
LINEAR = 2e-3
"""Relative error of a central difference in single precision."""

AWAY, WIDTH, DEPTH = np.array([-4.2, 0.0, 0.0]), 1.4, 0.7


def cloud(points, depth=DEPTH):
    """Return the extinction of a round cloud beside the flame at points ``(..., 3)``."""
    square = np.square(np.asarray(points) - GRID.center - AWAY).sum(axis=-1) / WIDTH**2
    return depth / (np.sqrt(2 * np.pi) * WIDTH) * np.exp(-square / 2)


def exposed(extinction, seed=0, noise=0.003):
    """Return what cameras record of the flame through gas, by fine steps along lines of sight."""
    images = []
    step = 0.3 * GRID.spacing[0]
    for camera in RIG:
        width, height = camera.image_size
        light = np.zeros((height, width))
        for right, down in np.ndindex(2, 2):
            columns, rows = np.meshgrid(np.arange(width), np.arange(height))
            at = np.stack([columns + right / 2 - 0.25, rows + down / 2 - 0.25], axis=-1)
            origins, directions = camera.rays(at.reshape(-1, 2))[:2]
            middle = np.linalg.norm(origins - GRID.center, axis=1)[:, None]
            along = middle + np.arange(-13, 13, step) + step / 2
            points = origins[:, None] + along[..., None] * directions[:, None]
            inside = ((points > GRID.lower) & (points < GRID.upper)).all(axis=-1)
            depth, emitted = np.zeros(inside.shape), np.zeros(inside.shape)
            depth[inside] = extinction(points[inside]) * step
            emitted[inside] = FLAME(points[inside]) * step
            left = np.exp(depth / 2 - np.cumsum(depth, axis=1))
            light += (emitted * left).sum(axis=1).reshape(height, width) / 4
        images.append(light)
    random, peak = np.random.default_rng(seed), max(image.max() for image in images)
    images = [(i + noise * peak * random.normal(size=i.shape)).astype(np.float32) for i in images]
    masks = tuple(np.ones(image.shape, bool) for image in images)
    read = tuple(map(estimate_noise, images, masks))
    return Observation(RIG, tuple(images), masks, read, GRID, supersample=2)


@pytest.fixture(scope="module")
def clouded():
    return exposed(cloud)


def field_of(function, field=None):
    """Return the values of a field's nodes, ``(nodes,)``."""
    field = field or Absorber(GRID)
    axes = [
        np.linspace(low, high, n)
        for low, high, n in zip(GRID.lower, GRID.upper, field.shape, strict=True)
    ]
    return function(np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1)).ravel()


def test_the_means_of_a_field_that_is_linear_are_its_values_in_voxel_centres():
    field = Absorber(GRID)
    for grid in (GRID, VoxelGrid.from_bounds((5, 31, 8), GRID.lower, GRID.upper)):
        found = field.means_in(grid) @ field_of(lambda p: 3 + p @ [0.1, -0.2, 0.3])
        expected = 3 + grid.centers() @ [0.1, -0.2, 0.3]
        np.testing.assert_allclose(found, expected.ravel(), rtol=1e-12)


def test_the_means_in_large_voxels_are_those_of_the_small_ones_in_them():
    field, values = Absorber(GRID), np.random.default_rng(0).random(field_of(cloud).size)
    fine = VoxelGrid.from_bounds([3 * n for n in GRID.shape], GRID.lower, GRID.upper)
    small = (field.means_in(fine) @ values).reshape(14, 3, 18, 3, 14, 3).mean(axis=(1, 3, 5))
    np.testing.assert_allclose(field.means_in(GRID) @ values, small.ravel(), rtol=1e-12)


@pytest.mark.parametrize("gas", [Absorption(), Absorption(0.02, 0.03)], ids=["clear", "gas"])
def test_columns_are_difference_quotients_of_single_rays(clouded, gas):
    field, random = Absorber(GRID), np.random.default_rng(1)
    volume = np.maximum(FLAME(GRID.centers()), 0).astype(np.float32)
    now = 0.02 + field_of(cloud)

    def seen(values):
        there = field.applied(replace(clouded, absorption=gas, supersample=1), values[None])
        (system,) = equations_of([there], None, [voxel_means(volume)])
        unknowns = system.projector.active.compress(volume)
        return there, system, unknowns, np.asarray(system.projector @ unknowns, np.float64)

    there, system, unknowns, _ = seen(now)
    found = field.columns(Prediction(there, system, unknowns))
    assert dot_test(found) < 1e-12
    assert dot_test(found, dtype=np.float32) < 1e-6
    every, one = np.ones(len(now)), np.eye(len(now))[640]
    for change, step in ((every, 3e-3), (random.random(len(now)), 3e-3), (one, 2e-2)):
        more, less = (seen(now + sign * step * change)[3] for sign in (1, -1))
        expected = (more - less) / (2 * step)
        column = found @ change
        assert (column <= 1e-9).all()  # gas takes light
        assert np.linalg.norm(column - expected) < LINEAR * np.linalg.norm(expected)


def test_lengths_in_another_unit_are_the_same_gas():
    large = VoxelGrid(GRID.shape, 10.0, tuple(10 * np.asarray(GRID.center)))
    one, other, light = Absorber(GRID), Absorber(large), FLAME(GRID.centers())
    values = field_of(cloud)
    assert other.shape == one.shape
    assert other.deviation(exposed_none())[0] == pytest.approx(
        one.deviation(exposed_none())[0] / 10
    )
    depth, where = one.seen_from(values, light)
    assert other.seen_from(values / 10, light) == (pytest.approx(depth), where)


def exposed_none():
    dark = tuple(np.zeros((30, 24), np.float32) for _ in RIG)
    return Observation(RIG, dark, tuple(d == 0 for d in dark), (), GRID)


def test_words_say_on_which_side_gas_is():
    field, light = Absorber(GRID), FLAME(GRID.centers())
    depth, where = field.seen_from(field_of(cloud), light)
    assert where == "beside the flame, on its -x side,"
    fine = VoxelGrid.from_bounds((56, 72, 56), GRID.lower, GRID.upper)
    means = (field.means_in(fine) @ field_of(cloud)).reshape(fine.shape)
    assert depth == pytest.approx(means.sum(axis=0).max() * fine.spacing[0], rel=0.05)

    def sheath(points):
        radius = np.hypot(*np.moveaxis(points - GRID.center, -1, 0)[[0, 2]])
        return 0.5 / (np.sqrt(2 * np.pi)) * np.exp(-np.square(radius - 5) / 2)

    assert field.seen_from(field_of(sheath), light)[1] == "around the flame"


def depth_through(extinction):
    """Return the optical depth along x through the middle of the cloud, from voxel means."""
    return extinction.values[:, 8:10, 6:8].mean(axis=(1, 2)).sum() * GRID.spacing[0]


def test_a_known_cloud_is_found_and_its_depth_too(clouded):
    effects = (Gain(), Absorbing(own=False), Absorber(GRID))
    found = infer([clouded], effects)
    state = found.state
    assert [name for name, free in state.free.items() if free.any()] == ["absorber"]
    points = GRID.lower + (np.indices((140, 20, 20)).reshape(3, -1).T + 0.5) * 0.1
    points[:, 1:] += np.array([8, 6])
    true = cloud(points).reshape(140, -1).mean(axis=1).sum() * 0.1
    (fit,) = state.fits
    assert depth_through(fit.observation.absorption.extinction) == pytest.approx(true, rel=0.15)
    truth = FLAME(GRID.centers())

    def error(fit):
        return np.linalg.norm(fit.means - truth) / np.linalg.norm(truth)

    assert error(fit) < 0.5 * error(first_fit(clouded))


def test_a_transparent_scene_gets_exactly_nothing():
    clear = exposed(lambda points: np.zeros(points.shape[:-1]))
    field = Absorber(GRID)
    fit = first_fit(clear)
    assert not rises([fit], field)
    assert not next_fits([fit], (field,))[1]["absorber"].any()  # as said, the step is zero
    found = infer([clear], (Gain(), Absorbing(own=False), field))
    assert not found.state.fits[0].observation.absorption
    assert not found.state.values["absorber"].any()
