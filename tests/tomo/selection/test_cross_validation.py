from dataclasses import replace

import numpy as np
import pytest

from tomo import solvers
from tomo.operators import GaussianBasis
from tomo.selection.cross_validation import (
    CHECKPOINTS,
    PATIENCE,
    PIXEL_STRIDE,
    SETTLED,
    STILL_FALLING,
    Fold,
    views_to_leave_out,
)
from tomo.solvers.curvature import FIRST

VIEWS = list(range(9))


@pytest.fixture(scope="module")
def noisy(ring_system):
    noise = np.random.default_rng(0).standard_normal(len(ring_system.measured))
    return (ring_system.measured + 0.1 * ring_system.measured.max() * noise).astype(np.float32)


@pytest.fixture(scope="module")
def fold(ring_system, noisy):
    return Fold.leaving_out([2, 6], VIEWS, ring_system.projector, noisy)


@pytest.mark.parametrize("count", [3, 4, 5, 8, 9, 11, 16, 33, 100])
def test_trials_leave_out_different_views_and_keep_most(count):
    views = list(range(10, 10 + count))
    folds = views_to_leave_out(views)
    assert len(folds) == 1
    left_out = [view for fold in folds for view in fold]
    assert len(set(left_out)) == len(left_out)
    assert set(left_out) <= set(views)
    assert all(1 <= len(fold) <= max(count / 5, 1) for fold in folds)


def test_a_fit_holds_no_pixel_of_the_left_out_or_unnamed_views_for_training(ring_system):
    projector, measured = ring_system.projector, ring_system.measured.copy()
    for view in (1, 3, 5):  # left out: 3 and 5; never named: 1
        measured[projector.pixels_of([view])] = 1e30
    views = [0, 2, 3, 4, 5, 6, 7, 8]
    found = Fold.leaving_out([3, 5], views, projector, measured)
    assert np.count_nonzero(np.diff(found.training.view_ptr)) == 6
    assert found.training_pixels.max() < 1e30
    meets = found.left_out.row_sums > 0  # the others see no voxel: nothing could predict them
    assert 0.5 < meets.mean() < 1
    np.testing.assert_array_equal(found.left_out_pixels, np.where(meets, np.float32(1e30), 0))
    x = ring_system.truth.ravel()
    np.testing.assert_array_equal(found.training @ x, found.training_pixels)
    np.testing.assert_array_equal(
        found.left_out @ x, ring_system.measured[projector.pixels_of([3, 5])]
    )


def test_scattered_pixels_are_of_the_training_views_and_evaluated_apart(ring_system):
    projector, measured = ring_system.projector, ring_system.measured
    found = Fold.leaving_out([3], VIEWS, projector, measured, scatter=True)
    own = np.diff(found.left_out.view_ptr)
    kept = np.diff(projector.view_ptr) - np.diff(found.training.view_ptr)
    np.testing.assert_array_equal(own, kept)
    others = np.delete(own, 3)
    assert others == pytest.approx(
        np.delete(np.diff(projector.view_ptr), 3) / PIXEL_STRIDE, rel=0.05
    )
    assert np.count_nonzero(found.scattered) == others.sum()
    start, stop = found.left_out.view_ptr[3:5]
    assert not found.scattered[start:stop].any()
    truth = ring_system.truth.ravel()
    np.testing.assert_array_equal(found.training @ truth, found.training_pixels)
    np.testing.assert_array_equal(found.left_out @ truth, found.left_out_pixels)
    assert found.squared_error(truth).tolist() == [0, 0]
    of_view, of_others = (
        np.mean(np.square(found.left_out_pixels[mask], dtype=np.float64))
        for mask in (~found.scattered, found.scattered)
    )
    assert found.dark[0] == pytest.approx(of_view * own[3], rel=1e-6)
    assert found.dark[1] == pytest.approx(of_others * own[3], rel=1e-6)


@pytest.mark.parametrize("scatter", [False, True])
def test_weights_go_with_their_pixels_and_errors_are_weighed(ring_system, noisy, scatter):
    projector = ring_system.projector
    weights = np.random.default_rng(1).uniform(0.1, 1, len(noisy)).astype(np.float32)
    how = {"scatter": scatter, "weights": weights}
    found = Fold.leaving_out([3], VIEWS, projector, weights, **how)  # pixels show their weights
    np.testing.assert_array_equal(found.training_weights, found.training_pixels)
    meets = found.left_out.row_sums > 0
    np.testing.assert_array_equal(found.left_out_weights[meets], found.left_out_pixels[meets])

    weighed = Fold.leaving_out([3], VIEWS, projector, noisy, **how)
    volume = ring_system.truth.ravel()
    misfit = (weighed.left_out @ volume - weighed.left_out_pixels).astype(float)
    squares = weighed.left_out_weights * misfit**2
    own, others = squares[~weighed.scattered], squares[weighed.scattered]
    expected = [own.sum(), others.mean() * len(own) if scatter else 0.0]
    np.testing.assert_allclose(weighed.squared_error(volume), expected, rtol=1e-5)
    even = replace(weighed, left_out_weights=None)
    assert even.squared_error(volume)[0] == pytest.approx(np.sum(misfit[~weighed.scattered] ** 2))


@pytest.mark.parametrize("method", ["mlem", "nnls"])
@pytest.mark.parametrize("width", [0.0, 0.75])
def test_the_errors_are_those_of_runs_of_just_so_many_iterations(fold, method, width):
    errors = fold.squared_errors(method, width, {"iterations": 5})
    basis = GaussianBasis(fold.training, width) if width else None
    for at in np.flatnonzero(np.isfinite(errors[:, 0])):
        found = getattr(solvers, method)(
            basis or fold.training,
            fold.training_pixels,
            iterations=CHECKPOINTS[at],
            start=fold.start if method == "mlem" else None,
        ).volume.ravel()
        seen = fold.left_out @ (basis.to_voxels(found) if basis else found)
        expected = np.sum((seen.astype(float) - fold.left_out_pixels) ** 2)
        assert errors[at, 0] == pytest.approx(expected, rel=1e-5)
        assert errors[at, 1] == 0
    assert np.isinf(errors[5:]).all()


def test_a_fit_ends_where_its_error_settles(fold):
    errors = fold.squared_errors("nnls", 0.0, {"iterations": 40}).sum(axis=1)
    reached = np.flatnonzero(np.isfinite(errors))
    last = reached[-1]
    dark = np.sum(fold.left_out_pixels.astype(float) ** 2)
    assert 2 <= last < CHECKPOINTS.index(40)
    gained = -np.diff(errors[: last + 1])
    share = gained / (dark - errors[1 : last + 1])
    assert share[-1] < SETTLED
    assert (share[1:-1] >= SETTLED).all()
    most = {"iterations": CHECKPOINTS[-1]}
    longer = fold.squared_errors("nnls", 0.0, most, to_the_end=True).sum(axis=1)
    np.testing.assert_array_equal(longer[: last + 1], errors[: last + 1])
    assert np.isfinite(longer).all()


def test_a_patient_fit_goes_on_while_it_gains(ring_system):
    projector, measured = ring_system.projector, ring_system.measured
    fold = Fold.leaving_out([2, 6], VIEWS, projector, measured)
    settings = {"iterations": CHECKPOINTS[-1], "strength": 1e-4}
    hasty = fold.squared_errors("tikhonov", 0.0, settings).sum(axis=1)
    errors = fold.squared_errors("tikhonov", 0.0, settings, patient=True).sum(axis=1)
    reached = np.isfinite(hasty).sum()
    np.testing.assert_array_equal(errors[:reached], hasty[:reached])
    errors = errors[np.isfinite(errors)]
    assert len(errors) > reached
    assert errors[-1] < 0.5 * hasty[reached - 1]
    gained = -np.diff(errors[reached - 1 :]) / errors[reached:]
    assert (gained[:-1] >= STILL_FALLING).all()
    assert gained[-1] < STILL_FALLING or len(errors) == len(CHECKPOINTS)


def test_a_fit_is_not_judged_before_its_own_penalty_is_in_force(ring_system):
    fold = Fold.leaving_out([2, 6], VIEWS, ring_system.projector, ring_system.measured)
    settings = {"iterations": CHECKPOINTS[-1], "strength": 1e-4}
    every = fold.squared_errors("curvature", 0.0, settings, to_the_end=True)
    found = fold.squared_errors("curvature", 0.0, settings, after=FIRST, to_the_end=True)
    judged = [n > FIRST for n in CHECKPOINTS]
    np.testing.assert_array_equal(found[judged], every[judged])
    assert np.isinf(found[np.logical_not(judged)]).all()
    hopeless = fold.squared_errors("curvature", 0.0, settings, best=1e-9, after=FIRST)
    assert CHECKPOINTS[np.isfinite(hopeless[:, 0]).nonzero()[0][-1]] >= FIRST + PATIENCE


@pytest.mark.parametrize(("method", "width"), [("curvature", 0.0), ("tikhonov", 1.0)])
def test_a_fit_that_settles_at_once_is_judged_all_the_same(ring_system, method, width):
    dark = replace(
        Fold.leaving_out([2, 6], VIEWS, ring_system.projector, ring_system.measured),
        training_pixels=np.zeros(7 * 320, np.float32),
    )
    errors = dark.squared_errors(method, width, {"iterations": 40}, after=FIRST)
    judged = np.isfinite(errors).all(axis=1).nonzero()[0].tolist()
    assert judged == [CHECKPOINTS.index(min(n for n in CHECKPOINTS if n > FIRST))]
    np.testing.assert_array_equal(errors[judged[0]], dark.dark)


def test_a_fit_far_behind_the_best_ends_after_some_patience(ring_system):
    """Without noise every iteration helps, but not enough to wait for."""
    fold = Fold.leaving_out([2, 6], VIEWS, ring_system.projector, ring_system.measured)
    alone = fold.squared_errors("mlem", 2.0, {"iterations": 28})
    behind = fold.squared_errors("mlem", 2.0, {"iterations": 28}, best=1e-6)
    level = fold.squared_errors("mlem", 2.0, {"iterations": 28}, best=alone.sum(axis=1).min())
    reached = np.isfinite(level[:, 0]).sum()  # with little left to gain it may end sooner
    np.testing.assert_array_equal(level[:reached], alone[:reached])
    assert CHECKPOINTS[reached - 1] > PATIENCE
    reached = np.isfinite(behind[:, 0]).sum()
    np.testing.assert_array_equal(behind[:reached], alone[:reached])
    assert CHECKPOINTS[reached - 1] == PATIENCE < CHECKPOINTS[np.isfinite(alone[:, 0]).sum() - 1]


@pytest.mark.parametrize("factor", [2.0**-80, 2.0**80])
def test_squared_errors_neither_overflow_nor_vanish(ring_system, noisy, fold, factor):
    scaled = Fold.leaving_out([2, 6], VIEWS, ring_system.projector, noisy * np.float32(factor))
    expected = fold.squared_errors("nnls", 0.0, {"iterations": 10})
    found = scaled.squared_errors("nnls", 0.0, {"iterations": 10})
    np.testing.assert_allclose(found, expected * factor**2, rtol=1e-6)
