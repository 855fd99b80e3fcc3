"""The world axes of a rig: changing them changes no image."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from rigs.calibrate.adjust.observation_arrays import ObservationArrays, Scene, predicted
from rigs.calibrate.adjust.projection import Lens
from rigs.calibrate.adjust.world import in_world

CAMERAS, FRAMES = ("left", "right", "top", "low"), ("a", "b", "c")


@pytest.fixture
def scene():
    rng = np.random.default_rng(0)
    turns = Rotation.from_rotvec(0.2 * rng.standard_normal((7, 3))).as_matrix()
    lens = Lens(np.diag([900.0, 900.0, 1.0]), "none", np.zeros(0))
    target_t = rng.standard_normal((3, 3))
    target_t[2] = np.nan
    return Scene(
        (lens,) * 4, turns[:4], 3 * rng.standard_normal((4, 3)) + [0, 0, 20], turns[4:], target_t
    )


def positions(scene):
    return -np.einsum("cji,cj->ci", scene.camera_R, scene.camera_t)


def pictures(scene):
    camera, frame, point = np.mgrid[:4, :2, :5].reshape(3, -1)
    points = np.random.default_rng(1).standard_normal((5, 3))
    return predicted(scene, ObservationArrays(camera, frame, points[point], np.zeros((40, 2))))


@pytest.mark.parametrize("world", [None, "right", "b"])
def test_axes_of_a_camera_or_of_a_frame(scene, world):
    moved, words, size, warning = in_world(scene, CAMERAS, FRAMES, world, False)
    assert not warning
    assert size == 1
    assert (world or "left") in words
    if world == "b":
        R, t = moved.target_R[1], moved.target_t[1]
    else:
        index = CAMERAS.index(world or "left")
        R, t = moved.camera_R[index], moved.camera_t[index]
    assert np.abs(R - np.eye(3)).max() < 1e-12
    assert np.abs(t).max() < 1e-12
    assert np.abs(pictures(moved) - pictures(scene)).max() < 1e-8


@pytest.mark.parametrize("size", [1.0, 2.5])
def test_given_positions_are_met(scene, size):
    R = Rotation.from_rotvec([0.3, -1.0, 2.0]).as_matrix()
    aim = size * positions(scene) @ R.T + [1, 2, 3]
    target = size * R @ scene.target_t[0] + [1, 2, 3]
    given = {"right": aim[1], "top": aim[2], "low": aim[3], "a": target}
    moved, words, found, warning = in_world(scene, CAMERAS, FRAMES, given, size != 1)
    assert not warning
    assert found == pytest.approx(size, rel=1e-12)
    assert np.abs(positions(moved) - aim).max() < 1e-9
    assert np.abs(moved.target_t[0] - target).max() < 1e-9
    assert ("set the scale" in words) == (size != 1)
    if size == 1:
        assert np.abs(pictures(moved) - pictures(scene)).max() < 1e-8


def test_a_mirrored_world_is_met_as_well_as_a_rotation_can(scene):
    aim = dict(zip(CAMERAS, positions(scene) * [-1, 1, 1], strict=True))
    moved, _, _, warning = in_world(scene, CAMERAS, FRAMES, aim, False)
    assert np.linalg.det(moved.camera_R) == pytest.approx(np.ones(4))
    assert "not mirrored" in warning[0]


def test_positions_in_another_unit_or_of_other_cameras_are_doubted(scene):
    right = positions(scene)
    for wrong in (right / 1000, right[::-1]):
        *_, warning = in_world(
            scene, CAMERAS, FRAMES, dict(zip(CAMERAS, wrong, strict=True)), False
        )
        assert warning[0].startswith("world: the given positions are met within")
    close = right + 0.01 * np.random.default_rng(3).standard_normal((4, 3))
    assert not in_world(scene, CAMERAS, FRAMES, dict(zip(CAMERAS, close, strict=True)), False)[3]


@pytest.mark.parametrize(
    ("world", "message"),
    [
        ("c", "world: frame c: found no pose"),
        ({"left": [0, 0, 0], "top": [1, 0, 0]}, "world: found 2 positions"),
        ({"left": [0, 0], "top": [1, 0, 0]}, "world: left: found .*3 numbers"),
        ({"left": [0, 0, 0], "top": [1, 0, 0], "low": [2, 0, 0]}, "not on a line"),
    ],
)
def test_worlds_that_cannot_be(scene, world, message):
    with pytest.raises(ValueError, match=message):
        in_world(scene, CAMERAS, FRAMES, world, False)
