from dataclasses import replace

import numpy as np
import pytest

import rigs
from tomo import LinearSystem, VoxelGrid
from tomo.selfcal.refine.held_out import HeldOutErrors, held_out_tiles, tiles_of
from tomo.selfcal.refine.joint_step import STIFFNESS, JointStep, SeenMoment, weight_of

GRID = VoxelGrid((3, 4, 3), 1.0)


def step(seed, views=(0, 2)):
    rig = rigs.ring(
        4, distance=50, image_size=(7, 8), footprint=0.8, pitch_degrees=[5, -20, 30, 0]
    )
    operator = LinearSystem.from_rig(rig, GRID).projector
    random = np.random.default_rng(seed)
    counts = np.diff(operator.view_ptr)
    moments = [
        SeenMoment(
            random.random(GRID.size) < 0.7,
            [random.normal(size=(8, counts[view])) for view in views],
        )
        for _ in range(2)
    ]
    joint = JointStep(
        operator,
        views,
        moments,
        random.uniform(0.5, 2.0, len(views)),
        random.normal(size=(len(views), 8)),
    )
    return joint, random.normal(size=(2, operator.shape[0]))


@pytest.mark.parametrize("seed", range(3))
def test_the_step_is_that_of_dense_least_squares(seed, monkeypatch):
    from tomo.selfcal.refine import joint_step as module

    monkeypatch.setattr(module, "ITERATIONS", 500)
    monkeypatch.setattr(module, "TOLERANCE", 1e-12)
    joint, residuals = step(seed)
    A = joint.operator @ np.eye(GRID.size)  # (pixels, unknowns)
    bound = joint.operator.T @ (joint.operator @ np.ones(GRID.size))
    free = np.concatenate([one.free for one in joint.moments])
    stiffness = STIFFNESS * np.median(np.tile(bound, 2)[free])
    moves = np.zeros((2, len(A), 16))
    for moment, own in zip(joint.moments, moves, strict=True):
        for number, view in enumerate(joint.views):
            span = slice(*joint.operator.view_ptr[view : view + 2])
            own[span, 8 * number : 8 * number + 8] = moment.derivatives[number].T
    volumes = np.kron(np.eye(2), A)[:, free]  # each moment has a volume of its own
    roots = np.sqrt(np.r_[np.full(free.sum(), stiffness), np.repeat(joint.weights, 8)])
    rows = np.vstack([np.hstack([volumes, np.vstack(moves)]), np.diag(roots)])
    prior = -roots[free.sum() :] * joint.departures.ravel()
    wanted = np.r_[residuals.ravel(), np.zeros(free.sum()), prior]
    dense = np.linalg.lstsq(rows, wanted, rcond=None)[0][free.sum() :]
    assert joint.solve(residuals).ravel() == pytest.approx(dense, abs=1e-5)


def test_residuals_that_another_volume_explains_move_no_camera():
    joint, _ = step(0)
    volume = np.random.default_rng(5).random(GRID.size)
    residuals = [np.asarray(joint.operator @ volume, np.float64)] * 2

    def moved(free):
        moments = tuple(replace(one, free=free) for one in joint.moments)
        settled = replace(joint, moments=moments, departures=np.zeros_like(joint.departures))
        return np.linalg.norm(settled.solve(residuals))

    assert moved(np.ones(GRID.size, bool)) < 0.05 * moved(np.arange(GRID.size) == 0)


def test_noise_weighs_each_pixel_and_an_error_in_common_each_tile():
    random = np.random.default_rng(3)
    tiles = np.repeat(np.arange(100), 25)
    derivatives = np.ones((1, 2500))
    noise = random.normal(size=2500)
    common = np.repeat(random.normal(size=100), 25)
    assert weight_of(derivatives, noise, tiles) == pytest.approx(1, rel=0.4)
    assert weight_of(derivatives, common, tiles) == pytest.approx(25, rel=0.4)


def test_a_fifth_of_the_pixels_is_held_out_in_whole_tiles():
    shapes = [(96, 64)] * 5
    held = np.array(held_out_tiles(shapes))
    assert held.mean() == pytest.approx(0.2, abs=0.02)
    tiles = tiles_of((96, 64))
    for own in held:
        assert all(len(set(own[tiles == tile])) == 1 for tile in np.unique(tiles))
    # no pixel is held out in all views, none in no view
    assert (held.sum(axis=0) == 1).all()


def test_an_improvement_has_to_exceed_chance():
    random = np.random.default_rng(0)
    before = HeldOutErrors(random.random((4, 50)) + 1, 100.0)
    assert before.is_improved_by(HeldOutErrors(0.9 * before.squared_errors, 100.0))
    assert not before.is_improved_by(before)
    assert not before.is_improved_by(HeldOutErrors(0.99 * before.squared_errors, 100.0))
    less = HeldOutErrors(0.97 * before.squared_errors, 100.0)  # as all cameras bring by chance
    assert not before.is_improved_by(less)
    assert before.is_improved_by(less, 0.4)
    assert not before.is_improved_by(HeldOutErrors(0.99 * before.squared_errors, 100.0), 0.0)
    # a 40th less in all, but by gains and losses of each tile that scatter far more
    scattered = random.normal(scale=2.0, size=(4, 50))
    scattered += before.squared_errors.sum() / 40 / scattered.size - scattered.mean()
    assert not before.is_improved_by(HeldOutErrors(before.squared_errors - scattered, 100.0), 0.4)


@pytest.mark.parametrize("scale", [1e-30, 1e-20, 1e20, 1e30])
def test_the_weight_is_a_squared_intensity_in_any_unit(scale):
    random = np.random.default_rng(0)
    derivatives, residual = random.standard_normal((2, 100)), random.standard_normal(100)
    tiles = np.arange(100) // 10
    expected = weight_of(derivatives, residual, tiles)
    found = weight_of(scale * derivatives, scale * residual, tiles)
    assert found / scale**2 == pytest.approx(expected, rel=1e-9)
