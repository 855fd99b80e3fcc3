"""Unequal gains and offsets are recovered; equal cameras are left alone."""

import math
from types import SimpleNamespace

import numpy as np
import pytest

import phantoms
import rigs
from tomo import solvers
from tomo.grid import VoxelGrid
from tomo.operators import LinearSystem
from tomo.selfcal.gains import Gains, estimate_gains, fit_gains, solve_with_gains
from tomo.simulation import simulate_images

VIEWS = 9


@pytest.fixture(scope="module")
def case():
    """Return nine cameras' images of a phantom, from finer voxels and several rays a pixel."""
    grid = VoxelGrid((14, 24, 14), 1.0)
    rig = rigs.ring(VIEWS, distance=300.0, image_size=(44, 60), footprint=0.5)
    field = phantoms.create("turbulent", seed=4, extent=grid.extent)
    made = simulate_images(rig, field, grid, supersample=2, refine=2)
    system = LinearSystem.from_rig(rig, grid)
    clean = system.flatten([made.images[name] for name in rig.names])
    random = np.random.default_rng(5)
    gain = np.exp(random.normal(0, 0.1, VIEWS))
    offset = random.normal(0, 0.01 * clean.max(), VIEWS)
    return SimpleNamespace(
        system=system,
        projector=system.projector,
        clean=clean,
        truth=made.truth,
        gain=gain / np.exp(np.log(gain).mean()),
        offset=offset,
        counts=np.diff(system.projector.view_ptr),
    )


def _seen(case, gain, offset=0.0):
    gain, offset = (np.broadcast_to(v, VIEWS) for v in (gain, offset))
    counts = case.counts
    return (np.repeat(gain, counts) * case.clean + np.repeat(offset, counts)).astype(np.float32)


def test_gains_and_offsets_are_recovered_without_the_truth(case):
    found = estimate_gains(case.system, _seen(case, case.gain, case.offset))
    assert np.abs(found.gain / case.gain - 1).max() < 0.008
    assert np.abs(found.offset - case.offset).max() < 0.001 * case.clean.max()
    assert np.exp(np.log(found.gain).mean()) == pytest.approx(1)
    assert found.views_disagree


def test_corrected_images_give_the_volume_that_equal_cameras_give(case):
    seen = _seen(case, case.gain, case.offset)
    gains = estimate_gains(case.system, seen)
    volumes = [
        solvers.nnls(case.projector, images, iterations=12).volume
        for images in (case.clean, seen, gains.correct(case.projector, seen))
    ]
    wrong, corrected = (np.linalg.norm(v - volumes[0]) for v in volumes[1:])
    assert corrected < 0.1 * wrong


def test_weights_of_corrected_pixels_are_those_of_their_noise(case):
    gains = fit_gains(case.system, _seen(case, case.gain), case.truth)
    noise = np.random.default_rng(9).uniform(0.5, 2, len(case.clean))
    corrected = gains.correct(case.projector, noise) - gains.correct(case.projector, 0 * noise)
    weights = gains.correct_weights(case.projector, (1 / noise**2).astype(np.float32))
    np.testing.assert_allclose(weights, 1 / corrected.astype(float) ** 2, rtol=1e-5)


@pytest.mark.parametrize("noise", [0.0, 0.02, 0.1])
def test_like_cameras_are_left_alone(case, noise):
    random = np.random.default_rng(6)
    images = case.clean + noise * case.clean.max() * random.standard_normal(len(case.clean))
    found = estimate_gains(case.system, images)
    assert not found.views_disagree
    assert (np.abs(found.gain - 1) < 4 * found.gain_error).all()


def test_a_report_names_the_cameras_also_where_a_view_is_dark(case):
    names = [f"cam{number}" for number in range(VIEWS)]
    seen = _seen(case, np.where(np.arange(VIEWS) == 3, 0, case.gain))
    found = fit_gains(case.system, seen, case.truth)
    report = found.report(names)
    assert report["gain"] == dict(zip(names, found.gain.tolist(), strict=True))
    assert report["gain"]["cam3"] == 1
    assert math.isinf(report["gain_error"]["cam3"])
    assert list(report["offset"]) == names
    with pytest.raises(ValueError, match="argument 2 is longer"):
        found.report(names[1:])


def test_noise_hides_no_large_gains(case):
    images = _seen(case, case.gain)
    random = np.random.default_rng(7)
    images = images + 0.05 * images.max() * random.standard_normal(len(images))
    found = estimate_gains(case.system, images)
    assert found.views_disagree
    assert np.std(np.log(found.gain / case.gain)) < 0.3 * np.std(np.log(case.gain))


def test_the_truth_gives_the_gains_to_the_simulation_s_accuracy(case):
    found = fit_gains(case.system, _seen(case, case.gain), case.truth, offsets=False)
    np.testing.assert_allclose(found.gain, case.gain, rtol=0.004)
    np.testing.assert_array_equal(found.offset, 0)


def test_a_common_factor_is_one_of_the_volume(case):
    seen = _seen(case, case.gain)
    once = estimate_gains(case.system, seen)
    twice = estimate_gains(case.system, 2 * seen)
    np.testing.assert_allclose(twice.gain, once.gain, rtol=1e-5)


def test_any_solver_alternates_with_the_gains(case):
    seen = _seen(case, case.gain)

    def solver(pixels):
        return solvers.mlem(case.projector, np.maximum(pixels, 0), iterations=8)

    found, gains = solve_with_gains(solver, case.system, seen, rounds=3)
    assert found.volume.shape == case.truth.shape
    assert np.abs(gains.gain / case.gain - 1).max() < 0.01
    with pytest.raises(ValueError, match="rounds: found 0"):
        solve_with_gains(solver, case.system, seen, rounds=0)


def test_a_dark_view_and_one_that_sees_something_else_get_no_gain(case):
    seen = _seen(case, 1.0)
    seen[case.projector.pixels_of([2])] = 0
    seen[case.projector.pixels_of([5])] *= 1000
    found = fit_gains(case.system, seen, case.truth)
    assert found.gain[[2, 5]].tolist() == [1, 1]
    assert np.isinf(found.gain_error[[2, 5]]).all()
    others = np.delete(np.arange(VIEWS), [2, 5])
    np.testing.assert_allclose(found.gain[others], 1, atol=0.005)


def test_one_view_or_dark_images_have_nothing_to_compare(case):
    one = LinearSystem(case.projector.view(0), case.system.rig[:1], case.system.pixels[:1])
    assert not estimate_gains(one, case.clean[: case.counts[0]]).views_disagree
    assert not estimate_gains(case.system, np.zeros(len(case.clean))).views_disagree


def test_correct_undoes_apply(case):
    gains = Gains(case.gain, case.offset, np.zeros(VIEWS), np.zeros(VIEWS))
    seen = gains.apply(case.projector, case.clean)
    np.testing.assert_allclose(seen, _seen(case, case.gain, case.offset), rtol=1e-6)
    np.testing.assert_allclose(
        gains.correct(case.projector, seen), case.clean, atol=1e-6 * case.clean.max()
    )
    with pytest.raises(ValueError, match="gains: found 9"):
        gains.apply(case.projector.view(0), case.clean[: case.counts[0]])


def test_bad_input_is_refused(case):
    with pytest.raises(ValueError, match="measured: found 3"):
        fit_gains(case.system, np.ones(3), case.truth)
    with pytest.raises(ValueError, match="volume: found 5"):
        fit_gains(case.system, case.clean, np.ones(5))
