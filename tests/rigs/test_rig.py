from dataclasses import replace

import numpy as np
import pytest

import rigs
from rigs import Camera, Rig, Volume, box_points, look_at, ring


@pytest.fixture
def rig():
    volume = Volume((30, 140, 30), 0.5, (1, 2, 3))
    return ring(12, distance=500, image_size=(40, 30), footprint=0.5, volume=volume)


def test_a_rig_is_a_sequence_of_named_cameras(rig):
    assert len(rig) == 12
    assert rig.names[:2] == ("cam00", "cam01")
    assert rig["cam03"] is rig[3] is rig.cameras[3]
    assert rig[-1].name == "cam11"
    assert rig[0::3].names == ("cam00", "cam03", "cam06", "cam09")
    assert isinstance(rig[0::3], Rig)
    assert rig[0::3].volume == rig.volume
    assert rig.without("cam00", "cam11").names == rig.names[1:-1]
    assert "cam05" in rig
    assert rig[5] in rig
    assert "cam99" not in rig
    assert [camera.name for camera in rig] == list(rig.names)


def test_a_rig_is_a_value(rig):
    names = {name: getattr(rigs, name) for name in rigs.__all__}
    again = replace(rig, cameras=tuple(eval(repr(camera), names) for camera in rig))
    assert again == rig
    assert hash(again) == hash(rig)
    assert rig != rig[::-1]
    figures = {"rms": [0.1]}
    calibrated = Rig(rig.cameras, calibration=figures)
    figures["rms"].append(0.2)
    assert calibrated.calibration == {"rms": [0.1]}


def test_unknown_names_list_the_known_ones(rig):
    for look_up in (lambda: rig["top"], lambda: rig.without("top")):
        with pytest.raises(
            ValueError, match="camera top: not in the rig, expected one of cam00, "
        ):
            look_up()
    with pytest.raises(IndexError):
        rig[12]


def test_a_name_stands_once(rig):
    with pytest.raises(ValueError, match="camera cam01: name: found twice"):
        Rig((*rig.cameras, rig[1]))


def test_a_rigid_motion_moves_cameras_and_volume(rig):
    R, t = look_at([1, 2, 3], [4, 6, 8])
    moved = rig.transformed(R, t)
    assert moved.volume is None  # it would stand askew
    points = np.random.default_rng(0).normal(size=(20, 3))
    for before, after in zip(rig, moved, strict=True):
        np.testing.assert_allclose(
            after.project(points @ R.T + t)[0], before.project(points)[0], atol=1e-9
        )
    quarter = np.array([[0.0, -1, 0], [1, 0, 0], [0, 0, 1]])
    turned = rig.transformed(quarter, [0, 0, 10])
    assert turned.volume == Volume((140, 30, 30), 0.5, (-2, 1, 13))
    corners = rig.volume.corners() @ quarter.T + [0, 0, 10]
    np.testing.assert_allclose(np.sort(turned.volume.corners(), 0), np.sort(corners, 0))


def test_footprint_is_depth_over_focal_length(rig):
    np.testing.assert_allclose(rig.footprint(), 0.5)
    behind = Rig((Camera("c", (4, 4), np.eye(3), t=[0, 0, -1]),))
    assert np.isnan(behind.footprint()).all()


@pytest.mark.parametrize(
    ("fields", "message"),
    [
        ({"shape": (0, 1, 1), "spacing": 1}, r"volume\.shape"),
        ({"shape": (1, 1.5, 1), "spacing": 1}, r"volume\.shape"),
        ({"shape": (1, 1, 1), "spacing": (1, 1, -1)}, r"volume\.spacing"),
        ({"shape": (1, 1, 1), "spacing": 1, "center": (0, 0)}, r"volume\.center"),
    ],
)
def test_bad_volumes_are_named(fields, message):
    with pytest.raises(ValueError, match=message):
        Volume(**fields)


def test_points_of_a_box_are_even_and_reach_its_faces():
    points = box_points((-1, 0, 5), (1, 4, 6), 3)
    assert points.shape == (27, 3)
    for axis, steps in enumerate(([-1, 0, 1], [0, 2, 4], [5, 5.5, 6])):
        assert np.unique(points[:, axis]).tolist() == steps
    assert len(np.unique(points, axis=0)) == 27
    volume = Volume((2, 8, 4), (1.0, 0.5, 0.25), (0.0, 2.0, 5.5))
    np.testing.assert_array_equal(volume.corners(), box_points((-1, 0, 5), (1, 4, 6), 2))
