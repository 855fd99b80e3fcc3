"""The target's way between pictures, against motions that are known exactly."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from rigs.calibrate.adjust.film import Film
from rigs.calibrate.adjust.observation_arrays import (
    ObservationArrays,
    Scene,
    jacobian,
    predicted,
)
from rigs.calibrate.adjust.projection import Lens

POINTS = np.c_[np.mgrid[-2:3, -1:2].reshape(2, -1).T * 0.1, np.zeros(15)]
LENS = Lens(np.array([[900.0, 0, 320], [0, 900, 240], [0, 0, 1]]), "none", np.zeros(0))


def pose(times):
    """Return poses at some moments: a screw motion and a sway."""
    times = np.asarray(times, float)[:, None]
    turn = np.array([0.2, -0.3, 0.1]) + 0.02 * times * [0.3, 1, -0.5]
    t = np.array([0, 0, 3.0]) + np.sin(times / 8 + [0, 1, 2]) * [0.2, 0.15, 0.1]
    return Rotation.from_rotvec(turn).as_matrix(), t


def film(offset=(0.0, 0.0), frames=20, gaps=()):
    """Return two cameras in one place, what they saw at their moments, and the film."""
    kept = np.setdiff1d(np.arange(frames), gaps)
    camera, frame, point = np.stack(
        np.meshgrid([0, 1], kept, np.arange(len(POINTS)), indexing="ij")
    ).reshape(3, -1)
    R, t = pose(np.arange(frames))
    R[list(gaps)], t[list(gaps)] = np.nan, np.nan
    eye = np.tile(np.eye(3), (2, 1, 1))
    scene = Scene((LENS, LENS), eye, np.zeros((2, 3)), R, t)
    at, to = pose(frame + np.array(offset)[camera])
    there = np.einsum("nij,nj->ni", at, POINTS[point]) + to
    uv = 900 * there[:, :2] / there[:, 2:] + [320, 240]
    arrays = ObservationArrays(camera, frame, POINTS[point], uv)
    return scene, arrays, Film.of(np.arange(float(frames)), arrays)


@pytest.mark.parametrize("late", [0.5, -0.3, 1.7])
def test_points_are_where_the_camera_saw_them(late):
    scene, arrays, found = film((0, late))
    moved = found.moved(scene, arrays, np.array([0, late]))
    known = np.isfinite(moved.points[:, 0])
    assert known[arrays.camera == 0].all()
    assert known.mean() > 0.9
    off = predicted(scene, moved.where(known)) - arrays.uv[known]
    assert np.abs(off).max() < 0.02  # pixels, where the board moves some 8 a picture


def test_velocities_are_derivatives_of_predictions():
    scene, arrays, found = film((0, 0.4))
    moved = found.moved(scene, arrays, np.array([0, 0.4]))
    moved = moved.where(np.isfinite(moved.points[:, 0]))
    rows = slice(int((moved.camera == 0).sum()), len(moved))
    _, by_camera, _ = jacobian(scene, moved, 1, rows)
    step = 1e-4
    ahead, behind = (
        predicted(replace(scene, offset=np.array([0, way * step])), moved)[rows] for way in (1, -1)
    )
    assert np.abs(by_camera[:, :, -1] - (ahead - behind) / (2 * step)).max() < 1e-4


def test_the_way_across_a_gap_is_not_known():
    scene, arrays, found = film((0, 0.5), frames=30, gaps=(10, 11))
    moved = found.moved(scene, arrays, np.array([0, 0.5]))
    unknown = np.unique(arrays.frame[np.isnan(moved.points[:, 0])])
    assert unknown.tolist() == [9, 29]


def test_images_are_filed_under_the_frames_whose_moments_they_show():
    _, arrays, found = film()
    rows, filed = found.filed(arrays, np.array([0.0, 3.0]))
    assert np.array_equal(filed.uv, arrays.uv[rows])
    late = filed.camera == 1
    assert np.array_equal(filed.frame[late], arrays.frame[rows][late] + 3)
    assert np.array_equal(filed.frame[~late], arrays.frame[rows][~late])
    assert filed.frame.max() == 19
    order = np.lexsort((filed.frame, filed.camera))
    assert np.array_equal(order, np.arange(len(filed)))


def test_poses_that_jump_are_no_film():
    _, arrays, _ = film()
    shuffled = np.random.default_rng(0).permutation(20)
    jumping = replace(arrays, frame=shuffled[arrays.frame])
    jumping = jumping.where(np.lexsort((jumping.frame, jumping.camera)))
    assert Film.of(np.arange(20.0), jumping) is None


def test_a_target_at_rest_is_no_film():
    _, arrays, _ = film()
    noise = 0.1 * np.random.default_rng(0).standard_normal(arrays.uv.shape)
    first = np.tile(arrays.uv[:15], (len(arrays) // 15, 1))
    assert Film.of(np.arange(20.0), replace(arrays, uv=first + noise)) is None
