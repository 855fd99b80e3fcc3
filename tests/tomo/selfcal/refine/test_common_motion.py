from dataclasses import replace

import numpy as np
import pytest

import rigs
from rigs import box_points
from tomo import VoxelGrid
from tomo.selfcal.refine.common_motion import without_common_motion
from tomo.selfcal.refine.parameters import COUNT, FOCAL, GAIN, moved_rig
from tomo.selfcal.refine.prior import units

GRID = VoxelGrid((20, 28, 20), 0.5)
POINTS = box_points(GRID.lower, GRID.upper, 5)


@pytest.fixture
def rig():
    pitch = [9, -14, 3, 20, -6]
    return rigs.ring(5, distance=300, image_size=(40, 56), footprint=0.4, pitch_degrees=pitch)


@pytest.fixture
def lengths(rig):
    return np.array([units(camera, GRID) for camera in rig])


def shifts_of_points(rig, parameters):
    """Return the apparent shift of each point of the volume, ``(points, 3)``."""
    moves, slopes = [], []
    for before, after in zip(rig, moved_rig(rig, parameters), strict=True):
        here = before.project(POINTS)[0]
        moves.append(after.project(POINTS)[0] - here)
        slopes.append(
            np.stack([(before.project(POINTS + e)[0] - here) for e in np.eye(3) * 1e-4], -1) / 1e-4
        )
    moves, slopes = np.stack(moves, 1), np.stack(slopes, 1)  # (points, views, 2[, 3])
    return np.array(
        [
            np.linalg.lstsq(slope.reshape(-1, 3), move.ravel(), rcond=None)[0]
            for slope, move in zip(slopes, moves, strict=True)
        ]
    )


@pytest.mark.parametrize("seed", range(3))
def test_a_common_motion_of_all_cameras_is_none(rig, lengths, seed):
    """The world turned and shifted a little: what is left is second order."""
    random = np.random.default_rng(seed)
    vector, shift = random.normal(size=(2, 3)) * 1e-4 * [[1.0], [100]]
    common = np.zeros((len(rig), COUNT))
    for index, camera in enumerate(rig):
        common[index, :3] = camera.R @ (shift + np.cross(vector, camera.position))
        common[index, 3:6] = -camera.R @ vector
    common[:, FOCAL] += 0.01
    common[:, GAIN] += 0.3
    assert np.abs(without_common_motion(rig, GRID, common, lengths) / lengths).max() < 1e-9
    # as a motion of the world says the same
    points = GRID.centers().reshape(-1, 3)[::531]
    common[:, FOCAL] = 0
    for before, after in zip(rig, moved_rig(rig, common), strict=True):
        world = points + shift + np.cross(vector, points)
        assert np.abs(after.project(world)[0] - before.project(points)[0]).max() < 1e-3


def test_what_no_common_motion_explains_stays(rig, lengths):
    own = np.zeros((len(rig), COUNT))
    own[0, 3] = lengths[0, 3]
    found = without_common_motion(rig, GRID, own, lengths)
    assert found[0, 3] > 0.5 * own[0, 3]
    again = without_common_motion(rig, GRID, found, lengths)
    assert np.allclose(again, found, atol=1e-12)


@pytest.mark.parametrize("seed", range(3))
def test_the_volume_stays_where_it_is_however_far_cameras_come_nearer(rig, lengths, seed):
    """Motion along the lines of sight is not visible and must not shift the volume."""
    own = np.random.default_rng(seed).normal(size=(len(rig), COUNT)) * lengths
    own[:, 2] *= 5
    own[:, FOCAL] = 0
    before = shifts_of_points(rig, own).mean(axis=0)
    after = shifts_of_points(rig, without_common_motion(rig, GRID, own, lengths)).mean(axis=0)
    assert np.linalg.norm(before) > 0.3 * min(GRID.spacing)
    assert np.linalg.norm(after) < 0.1 * min(GRID.spacing)


def test_a_camera_that_sees_nothing_does_not_move_the_volume(rig, lengths):
    away = replace(rig[2], t=rig[2].t + np.array([0, 0, -1000]))
    mixed = replace(rig, cameras=(*rig.cameras[:2], away, *rig.cameras[3:]))
    own = np.random.default_rng(0).normal(size=(len(rig), COUNT)) * lengths
    found = without_common_motion(mixed, GRID, own, lengths)
    assert np.isfinite(found).all()
    others = [0, 1, 3, 4]
    seeing = replace(rig, cameras=tuple(rig[view] for view in others))
    after = shifts_of_points(seeing, found[others]).mean(axis=0)
    assert np.linalg.norm(after) < 0.1 * min(GRID.spacing)
