import numpy as np
import pytest

from tomo.selection.fits import CHECKPOINTS, SETTLED, Fits
from tomo.selection.folds import Fold, blocks_to_leave_out, runs_of_pixels
from tomo.selection.smooth_solve import smooth_start, solve_smoothly


def folds_of(system, measured, count=2):
    runs = runs_of_pixels(system.projector)
    return [
        Fold.leaving_out(blocks_to_leave_out(runs, n), system.projector, measured, None, runs)
        for n in range(count)
    ]


@pytest.fixture(scope="module")
def noisy(ring_system):
    noise = np.random.default_rng(0).standard_normal(len(ring_system.measured))
    return (ring_system.measured + 0.1 * ring_system.measured.max() * noise).astype(np.float32)


@pytest.mark.parametrize("width", [0.0, 1.0])
def test_the_errors_are_those_of_a_run_of_just_so_many_iterations(ring_system, noisy, width):
    folds = folds_of(ring_system, noisy)
    found = Fits(folds).at(width, 1e-3)
    assert found.iterations in CHECKPOINTS
    expected = []
    for fold in folds:
        volume = solve_smoothly(
            fold.training,
            fold.training_pixels,
            width=width,
            strength=1e-3,
            iterations=found.iterations,
            start=smooth_start(fold.training, fold.training_pixels),
        ).volume
        expected.append(fold.squared_errors(volume.ravel()))
    # a fold that settled earlier counts with its last errors
    assert np.concatenate(expected).sum() == pytest.approx(found.error, rel=0.02)


def test_a_setting_is_run_once_and_a_hopeless_one_ends_early(ring_system, noisy):
    steps = []
    fits = Fits(folds_of(ring_system, noisy), progress=lambda *news: steps.append(news), total=9)
    good = fits.at(0.0, 1e-2)
    assert fits.at(0.0, 1e-2) is good
    assert len(steps) == 1
    alone = Fits(fits.folds).at(1.6, 0.3)
    behind = fits.at(1.6, 0.3)
    assert behind.error >= good.error
    assert behind.iterations <= alone.iterations
    assert fits.best is good
    assert [each[:2] for each in fits.tried] == [(0.0, 1e-2), (1.6, 0.3)]


def test_a_fit_ends_where_its_error_settles(ring_system, noisy):
    fits = Fits(folds_of(ring_system, noisy, 1))
    (fold,) = fits.folds
    errors = fits._errors(fold, fits._starts[0], 0.0, 1e-2, np.inf)
    sums = np.array([each.sum() for each in errors])
    assert 2 <= len(sums) < len(CHECKPOINTS)
    share = 1 - sums[1:] / sums[:-1]
    assert share[-1] < SETTLED
    assert (share[:-1] >= SETTLED).all()


@pytest.mark.parametrize("factor", [2.0**-60, 2.0**60])
def test_errors_neither_overflow_nor_vanish(ring_system, noisy, factor):
    expected = Fits(folds_of(ring_system, noisy, 1)).at(0.0, 1e-2)
    found = Fits(folds_of(ring_system, noisy * np.float32(factor), 1)).at(0.0, 1e-2)
    np.testing.assert_allclose(found.errors, expected.errors * factor**2, rtol=1e-5)
    assert found.iterations == expected.iterations
