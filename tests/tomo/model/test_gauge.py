"""Motions of the whole scene are no motion of cameras; that of one camera is."""

from dataclasses import replace

import numpy as np
import pytest

from tomo.model import without_gauge
from tomo.model.gauge import scene_motions
from tomo.model.pose import moved

ONE = np.array([1.5, -1.0, 0.4, -0.6, 0.8, 0.3])


@pytest.fixture(scope="module")
def motions(observed):
    return scene_motions(*observed)[0]


@pytest.mark.parametrize("mode", range(7))
def test_a_moved_scene_looks_like_moved_cameras(observed, motions, mode):
    observation, truth = observed
    step, span = 0.01 * min(observation.grid.extent), max(observation.grid.extent)
    brightest = np.argsort(truth.ravel())[-50:]
    points = observation.grid.centers().reshape(-1, 3)[brightest]
    if mode < 3:
        there = points + step * np.eye(3)[mode]
    elif mode < 6:
        there = points + step * np.cross(np.eye(3)[mode - 3], points) / span
    else:
        there = points + step * points / span
    for camera, motion in zip(observation.rig, motions[..., mode], strict=True):
        seen = moved(camera, motion, np.zeros(3)).project(points)[0]
        change = camera.project(there)[0] - camera.project(points)[0]
        far = np.abs(change).max()
        np.testing.assert_allclose(seen - camera.project(points)[0], change, atol=0.1 * far)


@pytest.mark.parametrize("seed", range(3))
def test_a_common_motion_goes_and_one_cameras_stays(observed, motions, seed):
    sizes = np.random.default_rng(seed).normal(size=7)
    common = motions @ sizes / np.abs(motions @ sizes).max()
    free = {"pose": np.ones((6, 6), bool)}
    for may in (None, free):
        left = without_gauge({"pose": common}, *observed, may)["pose"]
        np.testing.assert_allclose(left, 0, atol=1e-3)
    own = np.zeros((6, 6))
    own[2] = ONE
    left = without_gauge({"pose": common + own}, *observed)["pose"]
    np.testing.assert_allclose(left, own, atol=0.1)


@pytest.mark.parametrize("all_err", [False, True])
def test_cameras_that_the_rig_says_are_off_do_not_hold_the_scene(observed, motions, all_err):
    """Four of six stand elsewhere, all to one side: a rig that says so keeps the other two."""
    observation, truth = observed
    own = 0.2 * np.random.default_rng(0).normal(size=(6, 6)) + [2, 1, 0, 0, 0, 0]
    own[4:] = 0
    stated = [replace(c, status="nominal" if k < 4 else "virtual")
              for k, c in enumerate(observation.rig)]  # fmt: skip
    told = replace(observation, rig=replace(observation.rig, cameras=tuple(stated)))
    free = {"pose": np.ones((6, 6), bool)} if all_err else None
    with_it, without = (
        without_gauge({"pose": own}, seen, truth, free)["pose"] for seen in (told, observation)
    )
    assert np.abs(with_it[4:]).max() < 0.1
    np.testing.assert_allclose(with_it[:4], own[:4], atol=0.3)
    assert np.abs(without[4:]).max() > 0.3
    left = np.linalg.lstsq(motions.reshape(-1, 7), (with_it - without).ravel(), rcond=None)[0]
    np.testing.assert_allclose(motions @ left, with_it - without, atol=1e-6)  # a motion of it


def test_what_is_bright_stays_where_most_cameras_saw_it(observed, motions):
    """Where all poses are free, no motion of the scene brings images nearer to the given ones."""
    observation, truth = observed
    own = np.random.default_rng(5).normal(size=(6, 6))
    left = without_gauge({"pose": own}, *observed, {"pose": np.ones((6, 6), bool)})["pose"]
    assert np.abs(left - own).max() > 0.1
    order = np.argsort(-truth.ravel())[: truth.size // 20]
    points, light = observation.grid.centers().reshape(-1, 3)[order], truth.ravel()[order]

    def apart(poses):
        moves = [
            moved(camera, pose, np.zeros(3)).project(points)[0] - camera.project(points)[0]
            for camera, pose in zip(observation.rig, poses, strict=True)
        ]
        return sum(np.average(np.square(move).sum(axis=1), weights=light) for move in moves)

    for mode in motions[:, :, :6].transpose(2, 0, 1):
        mode = 0.2 * mode / np.abs(mode).max()
        assert apart(left) < min(apart(left + mode), apart(left - mode))


def test_a_gauge_is_taken_out_where_most_views_are_free(observed):
    own, free = np.zeros((6, 6)), {"pose": np.zeros((6, 6), bool)}
    own[2], free["pose"][2] = ONE, True
    np.testing.assert_array_equal(without_gauge({"pose": own}, *observed, free)["pose"], own)


@pytest.mark.parametrize("few", [5, 6])
def test_held_poses_keep_their_values_while_one_camera_stays(observed, motions, few):
    common, free = motions[:, :, 0], {"pose": np.ones((6, 6), bool)}
    free["pose"][few:] = False
    left = without_gauge({"pose": common}, *observed, free, held=["pose"])["pose"]
    np.testing.assert_allclose(left, common if few < 6 else 0, atol=1e-6)


def test_the_median_gain_is_one(observed):
    gain = np.array([[0.1], [0.12], [0.1], [0.5], [0.1], [-0.2]])
    found = without_gauge({"gain": gain}, *observed)["gain"]
    np.testing.assert_allclose(found, gain - 0.1)
