from dataclasses import replace

import numpy as np
import pytest

from tomo.selection.folds import (
    LEFT_OUT,
    RUN,
    Fold,
    blocks_to_leave_out,
    runs_of_pixels,
    surely_lower,
)


@pytest.fixture(scope="module")
def noisy(ring_system):
    noise = np.random.default_rng(0).standard_normal(len(ring_system.measured))
    return (ring_system.measured + 0.1 * ring_system.measured.max() * noise).astype(np.float32)


def test_a_model_is_surely_better_only_by_more_than_chance():
    random = np.random.default_rng(0)
    others = random.chisquare(1, 4000)
    assert surely_lower(0.9 * others, others)
    assert not surely_lower(others, others)
    assert not surely_lower(1.1 * others, others)
    chance = [surely_lower(random.chisquare(1, 400), random.chisquare(1, 400)) for _ in range(400)]
    assert 0.1 < np.mean(chance) < 0.22  # one standard error, one-sided: 0.16
    # what both models miss hides nothing
    alike = 100 * random.chisquare(1, 4000)
    assert surely_lower(alike + 0.9 * others, alike + others)


def test_folds_of_blocks_leave_out_every_block_once():
    blocks = np.repeat(np.arange(500) + 3, 4)
    held = np.array([blocks_to_leave_out(blocks, n) for n in range(round(1 / LEFT_OUT))])
    assert (held.sum(axis=0) == 1).all()
    for one in held:
        assert one.reshape(-1, 4).all(axis=1).sum() * 4 == one.sum()  # blocks stay whole
        assert one.mean() == pytest.approx(LEFT_OUT, rel=0.05)


def test_a_block_is_left_out_whichever_other_pixels_there_are():
    blocks = np.arange(400)
    some = np.random.default_rng(0).random(400) < 0.5
    np.testing.assert_array_equal(
        blocks_to_leave_out(blocks[some]), blocks_to_leave_out(blocks)[some]
    )


@pytest.mark.parametrize("width", [7, 8, 12, 13, 16, 24, 32])
def test_left_out_blocks_are_spread_over_rows_and_columns(width):
    held = blocks_to_leave_out(np.arange(width * 160)).reshape(160, width)
    for axis in (0, 1):
        longest = held.shape[axis] * LEFT_OUT
        assert held.sum(axis=axis).max() <= 1.4 * longest + 2
        assert held.sum(axis=axis).min() >= 0.6 * longest - 2


def test_runs_of_pixels_stay_in_their_view(ring_system):
    projector = ring_system.projector
    runs = runs_of_pixels(projector)
    assert (np.diff(runs) >= 0).all()
    assert np.bincount(runs).max() == RUN
    for start, stop in zip(projector.view_ptr[:-1], projector.view_ptr[1:], strict=True):
        assert not np.isin(runs[start:stop], np.delete(runs, slice(start, stop))).any()


def test_a_fold_of_views_holds_none_of_their_pixels_for_training(ring_system):
    projector, measured = ring_system.projector, ring_system.measured.copy()
    for view in (3, 5):
        measured[projector.pixels_of([view])] = 1e30
    held = np.zeros(len(measured), bool)
    held[projector.pixels_of([3, 5])] = True
    found = Fold.leaving_out(held, projector, measured)
    assert np.count_nonzero(np.diff(found.training.view_ptr)) == 7
    assert found.training_pixels.max() < 1e30
    meets = found.left_out.row_sums > 0  # the others see no voxel: nothing could predict them
    assert 0.5 < meets.mean() < 1
    np.testing.assert_array_equal(found.left_out_pixels, np.where(meets, np.float32(1e30), 0))
    x = ring_system.truth.ravel()
    np.testing.assert_array_equal(found.training @ x, found.training_pixels)
    np.testing.assert_array_equal(
        found.left_out @ x, ring_system.measured[projector.pixels_of([3, 5])]
    )


def test_the_truth_predicts_left_out_blocks_and_darkness_misses_their_light(ring_system):
    projector, measured = ring_system.projector, ring_system.measured
    runs = runs_of_pixels(projector)
    held = blocks_to_leave_out(runs)
    found = Fold.leaving_out(held, projector, measured, blocks=runs)
    assert len(np.unique(found.blocks)) == len(np.unique(runs[held]))
    np.testing.assert_array_equal(found.squared_errors(ring_system.truth.ravel()), 0)
    dark = found.squared_errors(np.zeros(projector.shape[1], np.float32))
    assert dark.sum() == pytest.approx(found.squared_light, rel=1e-6)


def test_weights_go_with_their_pixels_and_errors_are_weighed(ring_system, noisy):
    projector = ring_system.projector
    weights = np.random.default_rng(1).uniform(0.1, 1, len(noisy)).astype(np.float32)
    held = blocks_to_leave_out(runs_of_pixels(projector))
    found = Fold.leaving_out(held, projector, weights, weights)  # pixels show their weights
    np.testing.assert_array_equal(found.training_weights, found.training_pixels)
    meets = found.left_out.row_sums > 0
    np.testing.assert_array_equal(found.left_out_weights[meets], found.left_out_pixels[meets])
    weighed = Fold.leaving_out(held, projector, noisy, weights)
    volume = ring_system.truth.ravel()
    misfit = (weighed.left_out @ volume - weighed.left_out_pixels).astype(float)
    np.testing.assert_allclose(
        weighed.squared_errors(volume), weighed.left_out_weights * misfit**2, rtol=1e-5
    )
    even = replace(weighed, left_out_weights=None)
    np.testing.assert_allclose(even.squared_errors(volume), misfit**2, rtol=1e-5)
