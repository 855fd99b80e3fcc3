from dataclasses import replace

import numpy as np
import pytest

from rigs import Distortion, Rig, look_at, ring
from rigs.check import compare_rigs
from rigs.files.units import in_unit

POINTS = np.random.default_rng(1).uniform(-5, 5, (30, 3))
TURN = look_at((3, 1, 2), (0, 0, 0))[0]


def a_ring(count=5):
    return ring(count, distance=500.0, image_size=(160, 120), footprint=0.25, pitch_degrees=4.0)


def with_one(rig, name, **changes):
    return replace(rig, cameras=tuple(replace(c, **changes) if c.name == name else c for c in rig))


@pytest.mark.parametrize("count", [1, 2, 5])
def test_a_motion_of_the_world_is_found_and_leaves_nothing(count):
    rig = a_ring(count)
    found = compare_rigs(rig, rig.transformed(TURN, [10.0, -20.0, 30.0]), POINTS)
    np.testing.assert_allclose(found.R, TURN.T, atol=1e-12)
    np.testing.assert_allclose(found.t, -TURN.T @ [10.0, -20.0, 30.0], atol=1e-9)
    assert found.turn == pytest.approx(np.degrees(np.arccos((np.trace(TURN) - 1) / 2)))
    for camera in found.cameras:
        assert camera.distance < 1e-9
        assert camera.angle < 1e-6
        assert camera.focal_length == 0
        assert camera.lens < 1e-6
    assert found.ray_miss < 1e-9 if count > 1 else np.isnan(found.ray_miss)
    assert found.scale == pytest.approx(1) if count > 1 else np.isnan(found.scale)


def test_as_they_stand_a_shift_is_every_camera_s_distance():
    rig = a_ring()
    found = compare_rigs(rig, rig.transformed(np.eye(3), [3.0, 4.0, 0.0]), POINTS, align=False)
    assert [camera.distance for camera in found.cameras] == pytest.approx([5.0] * 5)
    assert found.shift == 0
    assert found.ray_miss < 1e-9


def test_the_camera_that_turned_is_reported_with_its_angle():
    rig = a_ring(12)
    angle = np.radians(0.5)
    c, s = np.cos(angle), np.sin(angle)
    turn = np.array([[1, 0, 0], [0, c, -s], [0, s, c]])
    old = rig["cam03"]
    other = with_one(rig, "cam03", R=turn @ old.R, t=turn @ old.t)
    found = compare_rigs(rig, other, POINTS, align=False)
    assert found.cameras[3].angle == pytest.approx(0.5)
    assert found.cameras[3].distance < 1e-9
    assert max(camera.angle for camera in found.cameras if camera.name != "cam03") == 0
    # half a degree over 500 mm, of which the other eleven take nearly nothing
    assert found.cameras[3].ray_miss == pytest.approx(500 * angle, rel=0.15)
    worst = max(compare_rigs(rig, other, POINTS).cameras, key=lambda camera: camera.angle)
    assert worst.name == "cam03"


def test_lenses_are_compared_in_pixels_over_the_image():
    rig = a_ring()
    shifted = np.add(rig[1].camera_matrix, [[0, 0, 3.0], [0, 0, 4.0], [0, 0, 0]])
    found = compare_rigs(rig, with_one(rig, "cam01", camera_matrix=shifted))
    assert found.cameras[1].lens == pytest.approx(5)
    assert found.cameras[1].distortion == pytest.approx(0, abs=1e-9)
    longer = rig[1].camera_matrix * [[1.02, 1, 1], [1, 1.02, 1], [1, 1, 1]]
    found = compare_rigs(rig, with_one(rig, "cam01", camera_matrix=longer))
    assert found.cameras[1].focal_length == pytest.approx(0.02)
    # 2 % of the distance from the middle, whose mean square is (w² + h²) / 12
    assert found.cameras[1].lens == pytest.approx(0.02 * np.hypot(160, 120) / np.sqrt(12), rel=0.1)
    k1 = 2.0
    bent = with_one(rig, "cam01", distortion=Distortion("brown", (k1, 0, 0, 0)))
    found = compare_rigs(rig, bent)
    f = rig[1].camera_matrix[0, 0]
    columns, rows = np.meshgrid(np.linspace(-80, 80, 25), np.linspace(-60, 60, 19))
    radius = np.hypot(columns, rows)
    expected = np.sqrt(np.mean((f * k1 * (radius / f) ** 3) ** 2))
    assert found.cameras[1].distortion == pytest.approx(expected, rel=1e-6)
    assert found.cameras[1].lens == pytest.approx(expected, rel=1e-6)
    assert found.cameras[0].lens < 1e-9


def test_units_are_taken_into_the_first_s_and_scale_is_stated():
    rig = a_ring()
    found = compare_rigs(rig, in_unit(rig, "m"), POINTS)
    assert found.ray_miss < 1e-9
    assert found.second.length_unit == "mm"
    larger = replace(rig, cameras=tuple(replace(c, t=1.01 * c.t) for c in rig))
    assert compare_rigs(larger, rig).scale == pytest.approx(1.01)


def test_cameras_of_one_rig_alone_are_named_and_none_in_common_is_refused():
    rig = a_ring()
    found = compare_rigs(rig[:4], rig[1:], POINTS)
    assert found.only_first == ("cam00",)
    assert found.only_second == ("cam04",)
    assert [camera.name for camera in found.cameras] == ["cam01", "cam02", "cam03"]
    with pytest.raises(ValueError, match="none in common: cam00 and cam01"):
        compare_rigs(Rig((rig[0],)), Rig((rig[1],)))
    with pytest.raises(ValueError, match="length_unit: found 'voxel'"):
        compare_rigs(rig, replace(rig, length_unit="voxel"))


def test_images_of_other_sizes_have_no_lens_difference():
    rig = a_ring(3)
    found = compare_rigs(rig, with_one(rig, "cam01", image_size=(80, 60)))
    assert np.isnan(found.cameras[1].lens)
    assert np.isfinite(found.cameras[0].lens)
