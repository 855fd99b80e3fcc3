import numpy as np
import pytest

from tomo.selection import fits
from tomo.selection.fits import CHECKPOINTS, SETTLED, Fits
from tomo.selection.folds import Fold, blocks_to_leave_out, runs_of_pixels
from tomo.selection.smooth_solve import smooth_start, solve_smoothly


def fold_of(system, measured):
    runs = runs_of_pixels(system.projector)
    held = blocks_to_leave_out(runs)
    return Fold.leaving_out(held, system.projector, measured, None, runs)


@pytest.fixture(scope="module")
def noisy(ring_system):
    noise = np.random.default_rng(0).standard_normal(len(ring_system.measured))
    return (ring_system.measured + 0.1 * ring_system.measured.max() * noise).astype(np.float32)


@pytest.mark.parametrize("width", [0.0, 1.0])
def test_the_error_is_that_of_a_run_of_just_so_many_iterations(ring_system, noisy, width):
    fold = fold_of(ring_system, noisy)
    found = Fits([fold]).at(width, 1e-3)
    assert found.iterations in CHECKPOINTS
    volume = solve_smoothly(
        fold.training,
        fold.training_pixels,
        width=width,
        strength=1e-3,
        iterations=found.iterations,
        start=smooth_start(fold.training, fold.training_pixels),
    ).volume
    expected = fold.squared_errors(volume.ravel()).sum()
    assert expected == pytest.approx(found.error, rel=1e-6)


def test_a_setting_is_run_once_and_a_hopeless_one_ends_early(ring_system, noisy):
    steps = []
    found = Fits([fold_of(ring_system, noisy)], progress=lambda *news: steps.append(news), total=9)
    good = found.at(0.0, 1e-2)
    assert found.at(0.0, 1e-2) is good
    assert len(steps) == 1
    alone = Fits(found.folds).at(1.6, 0.3)
    behind = found.at(1.6, 0.3)
    assert behind.error >= good.error
    assert behind.iterations <= alone.iterations
    assert [each[:2] for each in found.tried] == [(0.0, 1e-2), (1.6, 0.3)]


def test_a_fit_ends_where_its_error_settles(ring_system, noisy):
    fold = fold_of(ring_system, noisy)
    start = smooth_start(fold.training, fold.training_pixels)
    sums = np.array(fits._errors(fold, start, 0.0, 0.3, np.inf))
    assert 2 <= len(sums) < len(CHECKPOINTS)
    share = 1 - sums[1:] / sums[:-1]
    assert share[-1] < SETTLED
    assert (share[:-1] >= SETTLED).all()


def test_folds_are_stopped_where_together_they_predict_best(ring_system, noisy):
    runs = runs_of_pixels(ring_system.projector)
    folds = [
        Fold.leaving_out(blocks_to_leave_out(runs, n), ring_system.projector, noisy, None, runs)
        for n in range(2)
    ]
    both = Fits(folds).at(0.6, 1e-3)
    alone = [Fits([fold]).at(0.6, 1e-3) for fold in folds]
    assert sum(one.error for one in alone) <= both.error <= 1.05 * sum(o.error for o in alone)
    assert min(o.iterations for o in alone) <= both.iterations
    assert both.iterations <= max(o.iterations for o in alone)


def test_where_nothing_can_be_left_out_every_setting_is_as_good():
    found = Fits([])
    assert found.at(0.0, 1e-2).error == found.at(1.0, 1e-2).error == 0
    assert found.residual(found.at(0.0, 1e-2)) == 0


@pytest.mark.parametrize("factor", [2.0**-60, 2.0**60])
def test_errors_neither_overflow_nor_vanish(ring_system, noisy, factor):
    expected = Fits([fold_of(ring_system, noisy)]).at(0.0, 1e-2)
    found = Fits([fold_of(ring_system, noisy * np.float32(factor))]).at(0.0, 1e-2)
    assert found.error == pytest.approx(expected.error * factor**2, rel=1e-5)
    assert found.iterations == expected.iterations
