from dataclasses import replace

import numpy as np
import pytest

from rigs import Camera, Distortion, Optics, Rig, look_at, nearest_point, ray_distances, ring
from rigs.check.coverage import coverage, expected_ray_miss

BALL = np.random.default_rng(0).uniform(-5, 5, (40, 3))


def a_ring(count=5, **options):
    return ring(count, distance=500.0, image_size=(120, 120), footprint=0.25, **options)


def test_views_and_footprint_of_a_ring():
    rig = a_ring(pitch_degrees=[0, 5, -5, 10, 0])
    found = coverage(rig, BALL)
    assert (found.views == 5).all()
    at_middle = coverage(rig, [[0, 0, 0]])
    np.testing.assert_allclose(at_middle.footprint[:, 0], rig.footprint(), rtol=1e-6)
    depth = np.array([BALL @ camera.R[2] + camera.t[2] for camera in rig])
    np.testing.assert_allclose(found.footprint, depth / 2000, rtol=1e-4)


def test_footprint_follows_the_lens():
    pinhole = a_ring(1)[0]
    bent = replace(
        pinhole,
        camera_matrix=[[150.0, 0, 60], [0, 150, 60], [0, 0, 1]],
        distortion=Distortion("brown", (-0.3, 0.1, 0.002, -0.001)),
    )
    point = bent.position + 400 * bent.rays([[95.0, 20.0]])[1]
    # the solid angle of the pixel itself, by its corners
    corners = bent.rays(np.array([[94.5, 19.5], [95.5, 19.5], [95.5, 20.5], [94.5, 20.5]]))[1]
    one = np.linalg.norm(np.cross(corners[1] - corners[0], corners[3] - corners[0])) / 2
    other = np.linalg.norm(np.cross(corners[1] - corners[2], corners[3] - corners[2])) / 2
    found = coverage(Rig((bent,)), point)
    assert found.footprint[0, 0] == pytest.approx(400 * np.sqrt(one + other), rel=1e-4)


def test_points_beside_and_behind_are_not_seen():
    rig = a_ring(1)
    camera = rig[0]
    points = [camera.position - 10 * camera.R[2], camera.R[0] * 14.0, camera.R[0] * 16.0]
    found = coverage(rig, points)  # half an image is 15 mm wide
    assert found.seen[0].tolist() == [False, True, False]
    assert np.isnan(found.footprint[0, [0, 2]]).all()
    assert np.isnan(found.median_footprint[0])
    at_points = found.views_of(np.eye(3), 1.0).at_points()
    assert np.isfinite(at_points).tolist() == [False, True, False]
    assert np.isnan(found.ray_miss).all()


def test_blur_is_the_thin_lens_s_circle_of_confusion():
    f, number, focus, pitch = 50.0, 2.0, 480.0, 0.005
    behind = f * focus / (focus - f)  # where the sensor stands
    R, t = look_at((0, 0, 500), (0, 0, 0))
    K = [[behind / pitch, 0, 500], [0, behind / pitch, 500], [0, 0, 1]]
    camera = Camera("c", (1001, 1001), K, R=R, t=t, optics=Optics(f, number, focus))
    for z in (-30.0, 0.0, 20.0, 40.0):
        depth = 500 - z
        image = f * depth / (depth - f)
        spot = (f / number) * abs(behind - image) / image / pitch  # similar triangles
        found = coverage(Rig((camera,)), [[0, 0, z]])
        assert found.blur_in_pixels[0, 0] == pytest.approx(spot, rel=1e-6, abs=1e-9)
    unknown = replace(camera, optics=Optics(f, number))
    assert np.isnan(coverage(Rig((unknown,)), [[0, 0, 0]]).blur).all()


@pytest.mark.parametrize("count", [2, 3, 6])
def test_expected_ray_miss_is_that_of_disturbed_lines(count):
    rng = np.random.default_rng(count)
    positions = 300 * rng.normal(size=(count, 3))
    lines = -positions / np.linalg.norm(positions, axis=1, keepdims=True)
    error = rng.uniform(0.01, 0.05, count)
    squares = []
    for _ in range(4000):
        shift = rng.normal(size=(count, 3)) * error[:, None]
        shift -= (shift * lines).sum(axis=1, keepdims=True) * lines
        off = nearest_point(positions + shift, lines)[0] - positions - shift
        off -= (off * lines).sum(axis=1, keepdims=True) * lines
        squares.append((off**2).sum(axis=1).mean())
    expected = expected_ray_miss(lines[None], error[None])[0]
    assert expected == pytest.approx(np.sqrt(np.mean(squares)), rel=0.04)


def test_a_hidden_camera_leaves_the_expected_ray_miss_of_the_others():
    lines = np.eye(3)[None]  # (1 point, 3 cameras, 3)
    hidden = lines.copy()
    hidden[0, 2] = np.nan  # hardware stands before this camera
    miss = expected_ray_miss(hidden, np.array([[0.1, 0.2, np.nan]]))
    assert miss == pytest.approx(expected_ray_miss(lines[:, :2], np.array([[0.1, 0.2]])))


def test_ray_miss_scales_with_pixels_and_lengths():
    fine, coarse = (coverage(a_ring(), BALL, pixel_accuracy=a).ray_miss for a in (0.1, 0.3))
    np.testing.assert_allclose(coarse, 3 * fine)
    metres = Rig(tuple(replace(c, t=c.t / 1000) for c in a_ring()), "m")
    small = coverage(metres, BALL / 1000, pixel_accuracy=0.1)
    np.testing.assert_allclose(small.ray_miss, fine / 1000, rtol=1e-6)


def test_ray_miss_between_two_rigs_is_free_of_gauge_and_finds_the_camera_moved():
    rig = a_ring(7, pitch_degrees=3.0)
    turn = look_at((3, 1, 2), (0, 0, 0))[0]
    # a displacement of the world moves all lines alike
    np.testing.assert_allclose(
        ray_distances(rig, rig.transformed(turn, [1, 2, 3]), BALL), 0, atol=1e-9
    )
    moved = replace(rig[2], t=np.add(rig[2].t, [0.1, 0, 0]))
    other = replace(rig, cameras=(*rig.cameras[:2], moved, *rig.cameras[3:]))
    miss = np.sqrt((ray_distances(rig, other, BALL) ** 2).mean(axis=1))
    assert miss.argmax() == 2
    assert 0.05 < miss[2] < 0.1
    assert miss[[0, 1, 3, 4, 5, 6]].max() < 0.5 * miss[2]


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (dict(points=[[0, 0]]), "points: found shape"),
        (dict(points=[[0, 0, np.nan]]), "points: found shape"),
        (dict(points=BALL, pixel_accuracy=0), "pixel_accuracy: found 0"),
        (dict(points=BALL, pixel_accuracy=[0.1, 0.2]), "pixel_accuracy"),
    ],
)
def test_bad_input_is_reported(arguments, words):
    with pytest.raises(ValueError, match=words):
        coverage(a_ring(), **arguments)
    with pytest.raises(ValueError, match="rig: found no camera"):
        coverage(Rig(()), BALL)
