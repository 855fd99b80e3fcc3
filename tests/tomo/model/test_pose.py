"""A moved camera sees points where its motion says."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

import rigs
from tomo.model.pose import Pose, moved

SIZE, PIXEL = (36, 48), 0.6
CAMERA = rigs.ring(
    3, distance=200.0, image_size=SIZE, footprint=PIXEL, pitch_degrees=20, start_degrees=35
)[1]
MIDDLE = np.zeros(3)
RADIUS = min(SIZE) / 2
POINTS = np.random.default_rng(0).uniform(-5, 5, (20, 3))

pixels = st.floats(-3, 3)


def shift(points, *motion):
    """Return by how much a motion moves the images of points."""
    camera = moved(CAMERA, np.array(motion), MIDDLE)
    return camera.project(points)[0] - CAMERA.project(points)[0]


@given(pixels, pixels)
def test_a_shift_moves_all_images_alike(right, down):
    found = shift(POINTS, right, down, 0.0, 0.0, 0.0, 0.0)
    np.testing.assert_allclose(found, np.broadcast_to([right, down], found.shape), atol=1e-9)


@given(pixels, pixels)
def test_roll_and_zoom_are_about_the_principal_point(roll, zoom):
    x, y = ((CAMERA.project(POINTS)[0] - CAMERA.camera_matrix[:2, 2]) / RADIUS).T
    expected = np.stack([zoom * x - roll * y, zoom * y + roll * x], axis=1)
    second = (abs(roll) + abs(zoom)) ** 2 / RADIUS
    np.testing.assert_allclose(
        shift(POINTS, 0.0, 0.0, roll, zoom, 0.0, 0.0), expected, atol=second + 1e-9
    )


@given(pixels, pixels)
def test_a_walk_keeps_the_middle_and_moves_nearer_points_by_a_pixel(aside, above):
    nearer = MIDDLE - RADIUS * PIXEL * CAMERA.R[2]  # by half the image's shorter side
    found = shift(np.stack([MIDDLE, nearer]), 0.0, 0.0, 0.0, 0.0, aside, above)
    np.testing.assert_allclose(found[0], 0, atol=1e-9)
    np.testing.assert_allclose(np.abs(found[1]), np.abs([aside, above]), rtol=0.08, atol=0.01)


def test_a_table_of_rays_is_moved_as_its_camera():
    table = rigs.RayTable.of(CAMERA)
    motion = np.array([1.5, -0.7, 0.0, 0.0, 1.0, -2.0])
    np.testing.assert_allclose(
        moved(table, motion, MIDDLE).project(POINTS)[0],
        moved(CAMERA, motion, MIDDLE).project(POINTS)[0],
        atol=1e-3,
    )


def test_cameras_may_have_priors_of_their_own(observed):
    observation, _ = observed
    usual, own = (one.deviation(observation) for one in (Pose(), Pose(0, {"cam01": 2.0})))
    np.testing.assert_allclose(own[1], 4 * usual[1])
    assert 0 < np.delete(own, 1, axis=0).max() < 1e-5


def test_by_its_prior_a_camera_stands_off_by_as_much_as_it_looks_off(observed):
    seen, _ = observed
    for camera, own, pixel in zip(
        seen.rig, Pose(2.0).deviation(seen), seen.rig.footprint(), strict=True
    ):
        walk = np.array([0, 0, 0, 0, own[4], 0])
        step = np.linalg.norm(moved(camera, walk, MIDDLE).position - camera.position)
        np.testing.assert_allclose(step, own[0] * pixel, rtol=1e-3)
