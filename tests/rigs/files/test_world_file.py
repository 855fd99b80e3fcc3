"""A new world by a rigid motion, by three points, or by points' new places."""

import re
from dataclasses import replace

import numpy as np
import pytest
import yaml
from scipy.spatial.transform import Rotation

from rigs import Volume, ring
from rigs.files.world_file import load_world

POINTS = np.array([[1.0, 2, 3], [40, 0, 1], [0, 30, -2], [5, 5, 50]])
R = Rotation.from_rotvec([0.3, -1.2, 0.5]).as_matrix()
T = np.array([10.0, -20.0, 5.0])


@pytest.fixture
def rig():
    return RIG


RIG = ring(4, distance=500, image_size=(40, 30), footprint=0.5, volume=Volume((3, 4, 5), 2.0))


def world(tmp_path, unit="mm", **data):
    path = tmp_path / "world.yaml"
    path.write_text(yaml.safe_dump(data))
    return load_world(path, replace(RIG, length_unit=unit))


def assert_same_views(rig, moved, size=1.0, R=R, t=T):
    for before, after in zip(rig, moved, strict=True):
        expected = before.project(POINTS)[0]
        found = after.project(size * POINTS @ R.T + t)[0]
        np.testing.assert_allclose(found, expected, rtol=0, atol=1e-9)


def test_a_rigid_motion(tmp_path, rig):
    moved = world(tmp_path, R=R.tolist(), t=T.tolist(), world_frame="the table").of(rig)
    assert_same_views(rig, moved)
    assert moved.world_frame == "the table"
    assert moved.volume is None


def test_lengths_of_the_file_have_a_unit_of_their_own(tmp_path, rig):
    moved = world(tmp_path, R=R.tolist(), t=(T / 10).tolist(), length_unit="cm").of(rig)
    assert_same_views(rig, moved)
    message = re.escape("world.yaml: length_unit: found 'mm', expected unit, the rig's")
    with pytest.raises(ValueError, match=message):
        world(tmp_path, "unit", R=R.tolist(), t=T.tolist(), length_unit="mm")


def test_axes_by_three_points(tmp_path, rig):
    origin, on_x, in_plane = [0.0, 0, 7], [0.0, 3, 7], [-2.0, 1, 7]
    found = world(tmp_path, origin=origin, x_axis=on_x, xy_plane=in_plane)
    places = np.array([origin, on_x, in_plane]) @ found.R.T + found.t
    np.testing.assert_allclose(places, [[0, 0, 0], [3, 0, 0], [1, 2, 0]], atol=1e-12)
    moved = found.of(rig)
    assert_same_views(rig, moved, R=found.R, t=found.t)
    assert moved.volume == Volume((4, 3, 5), 2.0, (0, 0, -7))  # a quarter turn about z


def test_new_places_of_points(tmp_path, rig):
    places = POINTS @ R.T + T
    found = world(tmp_path, points=POINTS.tolist(), become=places.tolist())
    assert_same_views(rig, found.of(rig))
    assert found.misfit < 1e-12
    off = places + np.random.default_rng(0).normal(size=places.shape) * 0.1
    found = world(tmp_path, points=POINTS.tolist(), become=off.tolist())
    assert 0.01 < found.misfit < 0.3
    assert f"places of 4 points, met within {found.misfit:.3g} RMS" in found.of(rig).world_frame


def test_distances_of_points_set_the_scale_where_asked(tmp_path, rig):
    places = (2.5 * POINTS @ R.T + T).tolist()
    message = "become: found points off these places by .*, least at 2.5 times their size"
    with pytest.raises(ValueError, match=message):
        world(tmp_path, points=POINTS.tolist(), become=places)
    found = world(tmp_path, points=POINTS.tolist(), become=places, rescale=True)
    assert_same_views(rig, found.of(rig), size=2.5)
    figures = {"ray_miss_predicted": 0.1, "rms_px": 0.2, "length_unit": "mm"}
    calibrated = type(rig)(rig.cameras, calibration=figures)
    grown = found.of(calibrated).calibration
    assert grown == pytest.approx({**figures, "ray_miss_predicted": 0.25})


def test_new_positions_of_cameras(tmp_path, rig):
    places = {camera.name: (R @ camera.position + T).tolist() for camera in rig[1:]}
    assert_same_views(rig, world(tmp_path, **places, length_unit="mm").of(rig))
    assert_same_views(rig, world(tmp_path, **places, rescale=True).of(rig))
    two = dict(list(places.items())[:2])
    with pytest.raises(ValueError, match="points: found 2 points, expected 3 or more"):
        world(tmp_path, **two)


MIRRORED = (POINTS * [1, 1, -1]).tolist()
BAD = [
    ({"a": 1}, "found the keys 'a', expected R and t, or origin, x_axis and xy_plane, or points"),
    ({"R": R.tolist()}, "t: missing, expected R, t"),
    ({"R": R.tolist(), "t": [1, 2]}, "t: found shape (2,), expected 3 numbers"),
    ({"R": np.diag([1, 1, -1.0]).tolist(), "t": [0, 0, 0]}, "R: mirrored"),
    ({"R": np.eye(3).tolist(), "t": [0, 0, 0], "s": 2}, "'s': unknown, expected R, t, world_fram"),
    ({"R": np.eye(3).tolist(), "t": [0, 0, 0], "rescale": True}, "rescale: found true"),
    ({"R": np.eye(3).tolist(), "t": [0, 0, 0], "world_frame": 3}, "world_frame: found 3"),
    ({"R": np.eye(3).tolist(), "t": [0, 0, 0], "length_unit": "ell"}, "length_unit: found 'ell'"),
    ({"origin": [0, 0, 0], "x_axis": [1, 1, 1], "xy_plane": [2, 2, 2]}, "origin, x_axis, xy_plan"),
    ({"points": POINTS.tolist()}, "become: missing"),
    ({"points": POINTS.tolist(), "become": MIRRORED[:3]}, "become: found 3 points, expected 4"),
    ({"points": POINTS.tolist(), "become": MIRRORED}, "become: found points off these places"),
    ({"points": [[i, i, 0] for i in range(4)], "become": MIRRORED}, "points: found 4 points, exp"),
    ({"cam00": [0, 0, 0], "x": [1, 1, 1]}, "found the keys 'cam00, x', expected"),
    ({"cam00": 3, "cam01": [0, 0, 0]}, "cam00: found shape (), expected 3 numbers"),
    ({"rescale": True}, "found the keys 'rescale', expected R and t"),
    ({"points": 3, "become": 3}, "points: found shape ()"),
    ({"points": [[0, 0], [1, 1]], "become": 3}, "points: found shape (2, 2)"),
]


@pytest.mark.parametrize(("data", "message"), BAD)
def test_bad_files_are_one_line(tmp_path, data, message):
    with pytest.raises(ValueError, match=re.escape(f"world.yaml: {message}")) as caught:
        world(tmp_path, **data)
    assert len(str(caught.value).splitlines()) == 1
