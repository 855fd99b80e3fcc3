"""The choice of smoothness and stop, compared with the truth of phantoms."""

from types import SimpleNamespace

import numpy as np
import pytest

import phantoms
import rigs
from tomo.grid import VoxelGrid
from tomo.operators import LinearSystem, Projector
from tomo.rays import Rays
from tomo.selection import Choice, choose, choose_by_left_out_pixels, solve_as_chosen
from tomo.simulation import camera_noise
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
            choice = choose_by_left_out_pixels(projector, images)
            made[name, fraction] = SimpleNamespace(truth=truth, images=images, choice=choice)
    return made


def _true_error(projector, case, width, strength, iterations):
    choice = Choice(width, strength, iterations, 0.0)
    volume = solve_as_chosen(projector, case.images, choice).volume
    return np.linalg.norm(volume - case.truth) / np.linalg.norm(case.truth)


@pytest.mark.parametrize("name", ["jet", "turbulent"])
def test_more_noise_asks_for_more_smoothness(cases, name):
    clean, noisy, noisiest = (cases[name, fraction].choice for fraction in (0.0, 0.1, 0.3))
    assert clean.width <= noisy.width <= noisiest.width
    smoothness = [(one.width, one.strength) for one in (clean, noisy, noisiest)]
    assert smoothness[0] < min(smoothness[1:])  # a wider basis may come with as strong a prior
    assert clean.held_out_residual < noisy.held_out_residual < noisiest.held_out_residual


@pytest.mark.parametrize("name", ["jet", "turbulent"])
@pytest.mark.parametrize("fraction", [0.0, 0.1, 0.3])
def test_the_choice_is_nearly_the_truest_of_those_tried(projector, cases, name, fraction):
    case = cases[name, fraction]
    errors = [_true_error(projector, case, *tried[:3]) for tried in case.choice.tried]
    chosen = _true_error(projector, case, *case.choice.setting[:3])
    assert len(errors) >= 3
    assert max(errors) > 1.05 * min(errors)  # there was something to choose
    assert chosen <= 1.15 * min(errors)
    assert chosen < {0.0: 0.06, 0.1: 0.25, 0.3: 0.4}[fraction]


def test_the_choice_is_the_best_predictor_of_those_tried(cases):
    for case in cases.values():
        choice = case.choice
        best = min(choice.tried, key=lambda tried: tried.held_out_residual)
        assert choice.setting == best
        assert f"{choice.held_out_residual:.4f}" in choice.reason


def test_the_choice_is_the_same_each_time_and_for_every_brightness(projector, cases):
    case = cases["turbulent", 0.1]
    for factor in (1.0, 2.0**-80, 2.0**80):
        again = choose_by_left_out_pixels(projector, case.images * np.float32(factor))
        assert again.setting[:3] == case.choice.setting[:3]
        assert again.held_out_residual == pytest.approx(case.choice.held_out_residual, rel=1e-5)


def test_even_weights_change_nothing_and_others_reach_the_solver(projector, cases):
    case = cases["jet", 0.1]
    even = np.ones(len(case.images), np.float32)
    assert choose_by_left_out_pixels(projector, case.images, weights=even) == case.choice
    weights = np.random.default_rng(2).uniform(0.1, 1, len(even)).astype(np.float32)
    found, plain = (
        solve_as_chosen(projector, case.images, case.choice, weights=each)
        for each in (weights, None)
    )
    assert not np.array_equal(found.volume, plain.volume)


@pytest.mark.parametrize("views", [[3], [3, 9]])
def test_one_or_two_views_are_enough_to_choose(projector, cases, views):
    images = cases["jet", 0.1].images[projector.pixels_of(views)]
    few = projector.subset(views)
    choice = choose_by_left_out_pixels(few, images)
    assert choice.held_out_residual < 1
    assert np.isfinite(solve_as_chosen(few, images, choice).volume).all()


@pytest.mark.parametrize("size", [(1, 1), (2, 1), (2, 2)])
def test_a_choice_is_made_from_a_handful_of_pixels(size):
    rig = rigs.ring(3, distance=100.0, image_size=size, footprint=1.0)
    projector = LinearSystem.from_rig(rig, VoxelGrid((2, 2, 2), 1.0)).projector
    images = np.ones(projector.shape[0], np.float32)
    choice = choose_by_left_out_pixels(projector, images)
    assert np.isfinite(solve_as_chosen(projector, images, choice).volume).all()


def test_peaks_as_narrow_as_voxels_are_counted(projector):
    """A few bright voxels: no prior fits them, and MLEM, which has none, is chosen."""
    truth = np.zeros(projector.grid.shape, np.float32)
    truth[tuple(np.random.default_rng(1).integers(2, 12, (3, 8)))] = 1
    images = (projector @ truth.ravel()).astype(np.float32)
    choice = choose_by_left_out_pixels(projector, images)
    assert (choice.width, choice.strength, choice.method) == (0, 0, "mlem")
    found = solve_as_chosen(projector, images, choice)
    assert np.linalg.norm(found.volume - truth) < 0.05 * np.linalg.norm(truth)
    assert found.settings["strength"] == found.settings["smooth_width"] == 0


def test_dark_images_get_a_dark_volume(projector):
    images = np.zeros(projector.shape[0])
    choice = choose_by_left_out_pixels(projector, images)
    assert "dark" in choice.reason
    assert np.isnan(choice.held_out_residual)
    np.testing.assert_array_equal(solve_as_chosen(projector, images, choice).volume, 0)


def test_bad_images_are_refused(projector):
    with pytest.raises(ValueError, match="measured: found 3 pixels"):
        choose_by_left_out_pixels(projector, np.ones(3))
    images = np.ones(projector.shape[0])
    images[5] = np.nan
    with pytest.raises(ValueError, match="measured: found 1 NaN"):
        choose_by_left_out_pixels(projector, images)


def test_progress_counts_up_to_the_end(projector, cases):
    steps = []
    choose_by_left_out_pixels(
        projector, cases["turbulent", 0.1].images, progress=lambda *news: steps.append(news)
    )
    done = [step[0] for step in steps]
    assert done == sorted(done)
    assert done[0] == 0
    assert steps[-1][0] == steps[-1][1]
    assert all("choosing" in step[2] for step in steps[:-1])


def test_the_chosen_solve_is_reported_as_the_volume_itself(projector, cases):
    case, seen = cases["turbulent", 0.3], []
    found = solve_as_chosen(
        projector, case.images, case.choice, callback=lambda *news: seen.append(news)
    )
    assert found.settings["method"] == choose.METHOD
    assert found.settings["iterations"] == case.choice.iterations
    assert found.settings["smooth_width"] == case.choice.width
    np.testing.assert_array_equal(seen[-1][1], found.volume.ravel())
    assert found.volume.min() >= 0
    misfit = case.images - projector @ found.volume.ravel().astype(float)
    expected = np.linalg.norm(misfit) / np.linalg.norm(case.images)
    assert found.relative_residual == pytest.approx(expected, rel=1e-4)
    assert found.stop_reason.endswith(case.choice.reason)


@pytest.mark.parametrize("views", [[0, 2, 4, 6], [0, 3, 5]])
@pytest.mark.parametrize("fraction", [0.0, 0.1])
def test_few_views_are_solved_nearly_as_well_as_by_the_best_stopped(
    projector, cases, views, fraction
):
    case = cases["jet", fraction]
    images = case.images[projector.pixels_of(views)]
    few = projector.subset(views)
    choice = choose_by_left_out_pixels(few, images)
    case = SimpleNamespace(truth=case.truth, images=images)
    errors = [
        _true_error(few, case, width, strength, iterations)
        for width in (0.0, 1.0)
        for strength in (1e-4, 1e-3, 1e-2, 1e-1)
        for iterations in (5, 15, 40)
    ]
    assert _true_error(few, case, *choice.setting[:3]) <= 1.25 * min(errors)


def test_blocks_are_squares_of_so_many_voxels_in_each_image():
    grid = VoxelGrid((12, 12, 12), 1.0)
    rig = rigs.ring(3, distance=300.0, image_size=(40, 32), footprint=0.5)
    masks = [np.ones((32, 40), bool) for _ in rig]
    masks[1][:, ::2] = False
    system = LinearSystem.from_rig(rig, grid, masks=masks)
    blocks = system.blocks(2.0)  # four pixels
    assert blocks.shape == (system.projector.shape[0],)
    for number, kept in enumerate(system.pixels):
        start, stop = system.projector.view_ptr[number : number + 2]
        own, (rows, columns) = blocks[start:stop], np.divmod(kept, 40)
        place = rows // 4 * 1000 + columns // 4
        assert len(np.unique(own)) == len(np.unique(place))
        assert len(np.unique(own * 10**6 + place)) == len(np.unique(place))
        assert not np.isin(own, np.delete(blocks, slice(start, stop))).any()
    single = system.blocks(0.01)
    assert len(np.unique(single)) == len(single)
