"""The choice of method, smoothness and stop, judged against phantoms it was not designed on."""

from types import SimpleNamespace

import numpy as np
import pytest

import phantoms
import rigs
from tomo.grid import VoxelGrid
from tomo.operators import LinearSystem, Projector
from tomo.rays import Rays
from tomo.selection import (
    Choice,
    candidates,
    choose,
    choose_by_held_out_views,
    cross_validation,
    rules,
)
from tomo.selection.candidates import DEFAULT_STRENGTH
from tomo.selection.choose import solve_as_chosen
from tomo.simulation import camera_noise, simulate_images
from tomo.solvers.subsets import interleaved
from tomo.trace import trace

SEED = 11
WIDTH, HEIGHT = 44, 60
PIXELS = WIDTH * HEIGHT


@pytest.fixture(scope="module")
def projector():
    """Return sixteen cameras that all see the whole grid, two pixels to a voxel."""
    grid = VoxelGrid((14, 24, 14), 1.0)
    rig = rigs.ring(16, distance=300.0, image_size=(WIDTH, HEIGHT), footprint=0.5)
    rays = Rays.concatenate([Rays.from_camera(camera) for camera in rig])
    return Projector(trace(rays, grid), grid, np.arange(17) * PIXELS)


@pytest.fixture(scope="module")
def cases(projector):
    """Return clean and noisy images of a phantom sampled on finer voxels."""
    grid, made = projector.grid, {}
    for name in ("jet", "turbulent"):
        field = phantoms.create(name, seed=SEED, extent=grid.extent)
        truth = phantoms.sample(field, grid, refine=2)
        clean = projector @ truth.ravel()
        for fraction in (0.0, 0.1, 0.3):
            images = camera_noise.gaussian(clean, fraction, np.random.default_rng(SEED))
            images = images.astype(np.float32)
            choice = choose_by_held_out_views(projector, images)
            made[name, fraction] = SimpleNamespace(truth=truth, images=images, choice=choice)
    return made


def _true_error(projector, case, method, width, iterations):
    choice = Choice(method, width, iterations, 0.0)
    volume = solve_as_chosen(projector, case.images, choice).volume
    return np.linalg.norm(volume - case.truth) / np.linalg.norm(case.truth)


@pytest.mark.parametrize("name", ["jet", "turbulent"])
def test_noise_asks_for_an_earlier_stop_and_then_for_smoothness(cases, name):
    clean, noisy, noisiest = (cases[name, fraction].choice for fraction in (0.0, 0.1, 0.3))
    assert clean.width <= noisy.width
    assert noisy.width > 0 or noisy.iterations < clean.iterations
    assert noisiest.width > 0
    assert clean.held_out_residual < noisy.held_out_residual < noisiest.held_out_residual


@pytest.mark.parametrize("name", ["jet", "turbulent"])
@pytest.mark.parametrize("fraction", [0.0, 0.1, 0.3])
def test_the_choice_is_nearly_the_truest_of_those_tried(projector, cases, name, fraction):
    case = cases[name, fraction]
    choice = case.choice
    errors = [_true_error(projector, case, *candidate[:3]) for candidate in case.choice.tried]
    chosen = _true_error(projector, case, choice.method, choice.width, choice.iterations)
    assert len(errors) >= 2
    assert max(errors) > 1.05 * min(errors)  # there was something to choose
    assert chosen <= 1.3 * min(errors)
    assert chosen < {0.0: 0.06, 0.1: 0.4, 0.3: 0.6}[fraction]


def test_the_choice_predicts_as_well_as_any_tried_and_is_the_least_smooth_that_does(cases):
    for case in cases.values():
        choice = case.choice
        plain = [each for each in choice.tried if each[0] != "tikhonov"]
        best = min(plain, key=lambda candidate: candidate[3])
        found = (choice.method, choice.width, choice.iterations, choice.held_out_residual)
        assert found in [tried[:4] for tried in choice.tried]
        assert choice.width <= best[1]
        worth = rules.UNPENALISED_MARGIN if choice.method == "tikhonov" else 1.0
        assert worth * choice.held_out_residual**2 <= 1.04 * best[3] ** 2
        assert f"{choice.held_out_residual:.4f}" in choice.reason
        least = min(tried.held_out_residual for tried in choice.tried)
        assert ("predicts left-out views best" in choice.reason) == (
            choice.held_out_residual == least
        )
        assert f"{least:.4f}" in choice.reason


def test_the_choice_is_the_same_each_time_and_for_every_brightness(projector, cases):
    case = cases["turbulent", 0.1]
    for factor in (1.0, 2.0**-80, 2.0**80):
        again = choose_by_held_out_views(projector, case.images * np.float32(factor))
        assert (again.method, again.width, again.iterations) == (
            case.choice.method,
            case.choice.width,
            case.choice.iterations,
        )
        assert again.held_out_residual == pytest.approx(case.choice.held_out_residual, rel=1e-6)


def test_even_weights_change_nothing_and_others_reach_the_solver_but_for_mlem(projector, cases):
    case = cases["jet", 0.1]
    even = np.ones(len(case.images), np.float32)
    choice = choose_by_held_out_views(projector, case.images, weights=even)
    assert choice == case.choice
    weights = np.random.default_rng(2).uniform(0.1, 1, len(even)).astype(np.float32)
    for method, strength in (("nnls", None), ("tikhonov", 1e-3), ("mlem", None)):
        chosen = Choice(method, 0.5, 5, 0.1, strength)
        found, plain = (
            solve_as_chosen(projector, case.images, chosen, weights=each)
            for each in (weights, None)
        )
        assert np.array_equal(found.volume, plain.volume) == (method == "mlem")
    ours, theirs = (
        choose.residual_of_left_out_views(projector, case.images, case.choice, each)
        for each in (even, None)
    )
    assert ours == theirs == pytest.approx(case.choice.held_out_residual, rel=1e-6)


@pytest.mark.parametrize("views", [[3], [3, 9]])
def test_with_fewer_than_three_views_the_fallback_says_why(projector, cases, views):
    images = cases["jet", 0.1].images[projector.pixels_of(views)]
    choice = choose_by_held_out_views(projector.subset(views), images)
    assert (choice.method, choice.width, choice.iterations) == choose.FALLBACK
    assert "too few views" in choice.reason
    assert np.isnan(choice.held_out_residual)
    found = solve_as_chosen(projector.subset(views), images, choice)
    assert np.isfinite(found.volume).all()
    assert found.stop_reason.endswith(choice.reason)


def test_views_without_pixels_do_not_count(projector, cases):
    views = [3, 9]
    images = cases["jet", 0.1].images[projector.pixels_of(views)]
    two = projector.subset(views)
    padded = Projector(two.segments, two.grid, [0, 0, PIXELS, PIXELS, 2 * PIXELS])
    assert "too few views" in choose_by_held_out_views(padded, images).reason


def test_three_views_are_enough_to_choose(projector, cases):
    views = [0, 5, 11]
    images = cases["jet", 0.1].images[projector.pixels_of(views)]
    choice = choose_by_held_out_views(projector.subset(views), images)
    assert choice.tried
    assert np.isfinite(choice.held_out_residual)


@pytest.mark.parametrize("size", [(1, 1), (2, 1), (2, 2)])
def test_a_choice_is_made_from_a_handful_of_pixels(size):
    rig = rigs.ring(3, distance=100.0, image_size=size, footprint=1.0)
    projector = LinearSystem.from_rig(rig, VoxelGrid((2, 2, 2), 1.0)).projector
    images = np.ones(projector.shape[0], np.float32)
    choice = choose_by_held_out_views(projector, images)
    assert choice.held_out_residual < 1
    assert np.isfinite(solve_as_chosen(projector, images, choice).volume).all()


def test_dark_images_get_the_fallback_and_a_dark_volume(projector):
    images = np.zeros(projector.shape[0])
    choice = choose_by_held_out_views(projector, images)
    assert (choice.method, choice.width, choice.iterations) == choose.FALLBACK
    assert "dark" in choice.reason
    np.testing.assert_array_equal(solve_as_chosen(projector, images, choice).volume, 0)


@pytest.mark.parametrize("dark", [[2, 10], [6, 14], [2, 6, 10, 14]])
def test_a_choice_is_made_though_the_left_out_views_are_dark(projector, cases, dark):
    images = cases["jet", 0.0].images.copy()
    images[projector.pixels_of(dark)] = 0
    choice = choose_by_held_out_views(projector, images)
    assert np.isfinite(choice.held_out_residual)
    assert choice.iterations >= 1


def test_bad_images_are_refused(projector):
    with pytest.raises(ValueError, match="measured: found 3 pixels"):
        choose_by_held_out_views(projector, np.ones(3))
    images = np.ones(projector.shape[0])
    images[5] = np.nan
    with pytest.raises(ValueError, match="measured: found 1 NaN"):
        choose_by_held_out_views(projector, images)


def test_large_systems_are_thinned_evenly_over_rows_and_columns(projector, cases, monkeypatch):
    seen = []

    class Spy(cross_validation.Fold):
        @classmethod
        def leaving_out(cls, left_out, views, thinned, measured, **options):
            seen.append((thinned, measured))
            return super().leaving_out(left_out, views, thinned, measured, **options)

    case = cases["jet", 0.0]
    monkeypatch.setattr(candidates, "SEGMENTS_A_FOLD", projector.n_segments // 2 + 1)
    monkeypatch.setattr(candidates, "PIXELS_AN_UNKNOWN", 4)  # the system has nine
    monkeypatch.setattr(candidates, "Fold", Spy)
    choice = choose_by_held_out_views(projector, case.images)
    thinned, measured = seen[0]
    assert thinned.n_segments == pytest.approx(projector.n_segments / 2, rel=0.02)
    assert thinned.n_views == projector.n_views
    assert np.diff(thinned.view_ptr) == pytest.approx(PIXELS / 2, rel=0.02)
    # Pixels and rows still belong together: the truth predicts them
    np.testing.assert_array_equal(thinned @ case.truth.ravel(), measured)
    kept = np.isin(np.arange(len(case.images)), interleaved(len(case.images), 2)[0])
    np.testing.assert_array_equal(case.images[kept], measured)
    by_column = kept.reshape(-1, WIDTH).sum(axis=0)
    assert by_column.min() > 0.8 * by_column.mean()
    assert choice.method == case.choice.method


def test_thinning_keeps_what_overdetermines_a_system(projector, monkeypatch):
    monkeypatch.setattr(candidates, "SEGMENTS_A_FOLD", 1)
    monkeypatch.setattr(candidates, "PIXELS_AN_UNKNOWN", 4)  # the system has nine
    stride = candidates._stride(projector)
    assert stride >= 2
    assert projector.shape[0] / stride >= candidates.PIXELS_AN_UNKNOWN * projector.shape[1]
    few = projector.subset([0])  # fewer pixels than unknowns: nothing to keep
    assert few.shape[0] < few.shape[1]
    assert candidates._stride(few) == few.n_segments


def test_small_systems_are_not_thinned(projector, monkeypatch):
    assert candidates._stride(projector) == 1
    monkeypatch.setattr(candidates, "SEGMENTS_A_FOLD", projector.n_segments - 1)
    monkeypatch.setattr(candidates, "PIXELS_AN_UNKNOWN", 4)
    assert candidates._stride(projector) == 2


def test_progress_counts_up_to_the_end(projector, cases):
    told = []
    choose_by_held_out_views(
        projector, cases["turbulent", 0.1].images, progress=lambda *news: told.append(news)
    )
    done = [news[0] for news in told]
    assert done == sorted(done)
    assert told[0][0] == 0
    assert told[-1][0] == told[-1][1]
    assert all("choosing" in news[2] for news in told[:-1])


def test_what_was_chosen_is_run_and_reported_as_the_volume_itself(projector, cases):
    case, seen = cases["turbulent", 0.3], []
    found = solve_as_chosen(
        projector, case.images, case.choice, callback=lambda *news: seen.append(news)
    )
    assert case.choice.width > 0
    assert found.settings["method"] == case.choice.method
    assert found.settings["iterations"] == case.choice.iterations
    assert found.settings["smooth_width"] == case.choice.width
    np.testing.assert_array_equal(seen[-1][1], found.volume.ravel())
    assert found.volume.min() >= 0
    misfit = case.images - projector @ found.volume.ravel().astype(float)
    expected = np.linalg.norm(misfit) / np.linalg.norm(case.images)
    assert found.relative_residual == pytest.approx(expected, rel=1e-4)


def test_a_faint_penalty_is_taken_and_nearer_to_a_smooth_truth_than_none():
    """Images without inverse crime: voxels twice as fine, four rays a pixel."""
    grid = VoxelGrid((14, 24, 14), 1.0)
    rig = rigs.ring(16, distance=300.0, image_size=(WIDTH, HEIGHT), footprint=0.5)
    rays = Rays.concatenate([Rays.from_camera(camera) for camera in rig])
    projector = Projector(trace(rays, grid), grid, np.arange(17) * PIXELS)
    field = phantoms.GaussianBlobs([[1, 3, -1], [-2, -4, 1.5]], [1.6, 2.2], [1.0, 0.7])
    made = simulate_images(rig, field, grid, refine=2, supersample=2)
    images = np.concatenate([image.ravel() for image in made.images.values()])
    choice = choose_by_held_out_views(projector, images)
    assert choice.method == "tikhonov"
    assert (
        solve_as_chosen(projector, images, choice).settings["strength"]
        == DEFAULT_STRENGTH[projector.basis]
    )
    case = SimpleNamespace(truth=made.truth, images=images)
    errors = [
        _true_error(projector, case, method, choice.width, choice.iterations)
        for method in ("tikhonov", "nnls")
    ]
    assert errors[0] < 0.95 * errors[1]


def test_light_as_rough_as_boxes_is_found_without_a_penalty(projector, cases):
    case = cases["jet", 0.0]
    assert case.choice.method == "nnls"
    assert case.choice.tried[-1][0] == "tikhonov"
    errors = [_true_error(projector, case, *candidate[:3]) for candidate in case.choice.tried]
    assert min(errors[:-1]) < errors[-1]


def test_with_few_views_both_methods_are_tried_and_the_better_one_is_taken():
    grid = VoxelGrid((20, 28, 20), 1.0)
    rig = rigs.ring(4, 30.0, distance=60.0, image_size=(40, 60), footprint=0.5)
    rays = Rays.concatenate([Rays.from_camera(camera) for camera in rig])
    projector = Projector(trace(rays, grid), grid, np.arange(5) * 2400)
    field = phantoms.create("turbulent", seed=2, extent=grid.extent)
    truth = phantoms.sample(field, grid, refine=2)
    images = projector @ truth.ravel()
    choice = choose_by_held_out_views(projector, images)
    assert {candidate[0] for candidate in choice.tried} >= {"mlem", "tikhonov"}
    case = SimpleNamespace(truth=truth, images=images)
    errors = [_true_error(projector, case, *candidate[:3]) for candidate in choice.tried]
    chosen = _true_error(projector, case, choice.method, choice.width, choice.iterations)
    assert max(errors) > 1.3 * min(errors)  # there was something to choose
    assert chosen <= 1.2 * min(errors)


@pytest.mark.parametrize("views", [[0, 2, 4, 6], [0, 3, 5]])
def test_noise_in_few_views_is_told_from_what_they_leave_open(projector, cases, views):
    case = cases["jet", 0.1]
    images = case.images[projector.pixels_of(views)]
    few = projector.subset(views)
    choice = choose_by_held_out_views(few, images)
    case = SimpleNamespace(truth=case.truth, images=images)
    errors = [
        _true_error(few, case, method, width, iterations)
        for method in ("mlem", "nnls", "tikhonov")
        for width in (0.5, 0.8, 1.2)
        for iterations in (3, 6, 10, 17)
    ]
    chosen = _true_error(few, case, choice.method, choice.width, choice.iterations)
    assert chosen <= 1.2 * min(errors)
