"""Cameras that are refined for the asking: found, or left as they are, by left-out pixels."""

from dataclasses import replace

import numpy as np
import pytest

from rigs import box_points, ray_miss
from tomo.inference.infer import infer
from tomo.inference.left_out import LeftOut, predict_left_out, without_left_out
from tomo.inference.solve import first_fits, next_fit
from tomo.inference.state import State
from tomo.model import Gain, Pose

FOOTPRINT = 0.6


def with_cameras(observation, cameras):
    return replace(observation, rig=replace(observation.rig, cameras=tuple(cameras)))


@pytest.fixture(scope="module")
def wrong(observed, disturbed):
    """Return the observation with all cameras a third of a pixel wrong in six ways."""
    one, _ = observed
    return replace(one, rig=disturbed(one.rig, one.grid, 3, 0.35))


def refined(one, views, sigma=0.5):
    """Return what is found of some views, and their poses and gains, ``(6, 7)``."""
    chosen = np.isin(np.arange(6), views)
    names = np.array(one.rig.names)[chosen]
    poses = Pose(0.0, dict.fromkeys(names.tolist(), sigma))
    refine = {"pose": chosen, "gain": chosen}
    found = infer([one], (Gain(), poses), look_outside=False, refine=refine)
    values = found.state.values
    return found, np.hstack([values["pose"], values["gain"]])


def missed(observation, found, true):
    """Return by how much lines of sight miss each other, in pixels, before and after."""
    points = box_points(true.grid.lower, true.grid.upper, 4)
    rig = Pose().applied(observation, found.state.values["pose"]).rig
    return [ray_miss(true.rig, one, points) / FOOTPRINT for one in (observation.rig, rig)]


def test_all_cameras_are_found(wrong, observed):
    found, _ = refined(wrong, range(6))
    before, after = missed(wrong, found, observed[0])
    assert before > 0.5
    assert after < 0.25 * before
    assert found.left_out.is_better
    assert found.left_out.relative_errors[1] < 0.8 * found.left_out.relative_errors[0]


def test_exact_cameras_stay(observed):
    found, values = refined(observed[0], range(6))
    assert not found.left_out.is_better
    assert found.refined == {}
    assert not values.any()


@pytest.mark.parametrize("views", [[1], [0, 1, 2, 4, 5]])
def test_cameras_that_nobody_asked_for_hold_the_scene(wrong, observed, views):
    true = observed[0]
    mixed = with_cameras(true, [wrong.rig[n] if n in views else true.rig[n] for n in range(6)])
    found, values = refined(mixed, views)
    others = np.setdiff1d(np.arange(6), views)
    assert not values[others].any()
    before, after = missed(mixed, found, true)
    assert after < 0.3 * before


def test_a_gain_is_found_beside_a_pose(wrong, observed):
    true = observed[0]
    images = [0.8 * image if n == 3 else image for n, image in enumerate(true.images)]
    dim = replace(true, images=tuple(images))
    mixed = with_cameras(dim, [*true.rig[:3], wrong.rig[3], *true.rig[4:]])
    found, values = refined(mixed, [3])
    assert np.exp(values[3, 6]) == pytest.approx(0.8, abs=0.03)
    before, after = missed(mixed, found, true)
    assert after < 0.3 * before


def test_the_prior_says_how_far_cameras_may_go(observed):
    """A focal length that is 5 % wrong moves a pixel at the edge by one."""
    true = observed[0]
    wrong = list(true.rig)
    matrix = np.array(wrong[5].camera_matrix)
    matrix[:2, :2] *= 1.05
    wrong[5] = wrong[5].with_pose(matrix, wrong[5].R, wrong[5].t)
    seen = with_cameras(true, wrong)
    _, far = refined(seen, [5], sigma=3.0)
    assert np.expm1(far[5, 3] / 18) == pytest.approx(-0.05, abs=0.01)
    _, near = refined(seen, [5], sigma=1e-3)
    assert np.abs(near[5, :6]).max() < 0.05


def test_left_out_pixels_do_not_take_part(observed):
    """Fits without them are the same whatever they show; predictions are not."""
    fits = first_fits([observed[0]])
    (trained,) = without_left_out(fits)
    random = np.random.default_rng(0).random(len(trained.measured))
    other = np.where(trained.usable, trained.measured, random)
    one, changed = (next_fit(fit) for fit in (trained, replace(trained, measured=other)))
    assert 0.2 < 1 - trained.usable.mean() < 0.3
    np.testing.assert_allclose(changed.unknowns, one.unknowns, atol=1e-9)
    state = State(fits, {}, {}, np.zeros(6, bool))
    same = predict_left_out(state, state)
    assert not same.is_better
    assert 0 < same.relative_errors[0] == same.relative_errors[1] < 0.2


def test_errors_are_relative_to_the_light():
    found = LeftOut(np.array([0.4, 0.5]), np.array([0.04, 0.05]), pixels=10)
    np.testing.assert_allclose(found.relative_errors, (0.3, 0.3 / np.sqrt(10)))
    assert found.is_better
    assert found.is_clearly_better


def test_what_chance_makes_is_not_clearly_better():
    before = np.array([1.0, 0.1, 0.5, 0.2])
    found = LeftOut(before, before - [0.3, -0.2, -0.2, 0.2])
    assert found.is_better
    assert not found.is_clearly_better
    assert not LeftOut(found.after, found.before).is_better
    assert not LeftOut(np.zeros(0), np.zeros(0)).is_clearly_better
