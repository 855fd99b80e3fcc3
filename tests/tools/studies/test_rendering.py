"""Rendered boards: is what they show where the camera projects it to?"""

import numpy as np
import pytest
from studies.calibration import rendering, scenes

from rigs import Camera, Distortion, look_at
from rigs.calibrate.targets import parse_target

SIDE = 12.0  # mm
STRAIGHT = Distortion()


def camera(distortion=STRAIGHT, position=(60.0, -30.0, 300.0)):
    R, t = look_at(position, [0, 0, 0], [0, 1, 0])
    K = [[900, 0, 151.3], [0, 905, 118.6], [0, 0, 1]]
    return Camera("cam00", (300, 240), K, distortion, R, t)


def towards_z(target):
    """Return the pose of a target in the middle that faces +z."""
    R = np.diag([1.0, -1.0, -1.0])
    return R, -R @ target.points.mean(axis=0)


@pytest.mark.parametrize("edge", [0.0, 0.013, 0.11, 0.2347])
def test_an_edge_along_the_columns_lies_where_it_is(edge):
    """What a row's pixels sum to tells where its edge is: columns left of it are dark."""
    R, t = look_at([0, 0, 300], [0, 0, 0], [0, 1, 0])
    plain = Camera("cam00", (64, 8), [[900, 0, 31.5], [0, 900, 3.5], [0, 0, 1]], R=R, t=t)
    exposure = rendering.Exposure(black=0, white=1, shading=0, blur=0, noise=0)
    ink_left_of_it = np.repeat([[0] * 1000 + [255] * 1000], 8, axis=0)
    board = rendering.Board(ink_left_of_it, [edge - 80, -0.32], 0.08)
    picture = rendering.Photographer(plain, 4).picture(
        board, np.diag([1.0, -1.0, -1.0]), np.zeros(3), exposure
    )
    uv, _, _ = plain.project([[edge, 0.0, 0.0]])
    assert 63.5 - picture[4].sum() == pytest.approx(uv[0, 0], abs=0.01)


def test_corners_under_distortion_lie_where_the_camera_projects_them():
    import cv2

    target = parse_target(f"chessboard:7x5:{SIDE}")
    lens = Distortion("brown", (-0.3, 0.2, 2e-3, -1e-3))
    taker = camera(lens)
    R, t = towards_z(target)
    board = rendering.Board.of(target, 12.0)
    picture = rendering.Photographer(taker, 4).picture(board, R, t)
    uv, _, valid = taker.project(target.points @ R.T + t)
    assert valid.all()
    image = rendering.developed(picture, rendering.Exposure(noise=0), np.random.default_rng(0))
    found = cv2.cornerSubPix(
        image, np.float32(uv).reshape(-1, 1, 2), (5, 5), (-1, -1), (3, 100, 1e-4)
    ).reshape(-1, 2)
    assert np.abs(found - uv).max() < 0.08  # what OpenCV's refinement leaves
    assert np.abs((found - uv).mean(axis=0)).max() < 0.01
    straight, _, _ = camera().project(target.points @ R.T + t)
    assert np.abs(straight - uv).max() > 0.5  # the lens matters


def test_the_back_shows_no_print():
    target = parse_target(f"chessboard:7x5:{SIDE}")
    R, t = towards_z(target)
    behind = camera(position=(0.0, 0.0, -300.0))
    exposure = rendering.Exposure(shading=0)
    picture = rendering.Photographer(behind).picture(
        rendering.Board.of(target, 2.0), R, t, exposure
    )
    assert np.ptp(picture) < 1e-9
    assert picture[0, 0] == exposure.surroundings


def test_the_ring_s_targets_are_seen_by_some_and_never_by_all():
    rig = scenes.ring_rig(1)
    R, t = scenes.held(scenes.Poses(36, facing=180), np.zeros(3), np.random.default_rng(0))
    seen = np.array(
        [[scenes.faces(c, R[f], t[f], 70) for f in range(len(R))] for c in rig]
    )  # (cameras, frames)
    assert (seen.sum(axis=0) < len(rig)).all()
    assert (seen.sum(axis=1) >= 8).all()
    assert rig.footprint() == pytest.approx(scenes.FOOTPRINT, rel=0.05)


def test_photographs_are_the_same_for_any_number_of_workers(tmp_path):
    target = parse_target(f"chessboard:7x5:{SIDE}")
    rig = scenes.arc_rig(0, count=2)
    rig = type(rig)(tuple(c.scaled(0.2) for c in rig))
    board = rendering.Board.of(target, 2.0)
    poses = scenes.held(scenes.Poses(2), target.points.mean(axis=0), np.random.default_rng(3))
    taken = [
        scenes.photograph(tmp_path / str(n), rig, board, poses, seed=5, workers=n) for n in (1, 2)
    ]
    for name in rig.names:
        assert taken[0][name].keys() == taken[1][name].keys() != set()
        for frame, path in taken[0][name].items():
            assert path.read_bytes() == taken[1][name][frame].read_bytes()
