import numpy as np
import pytest

from rigs import Camera, image_motion


@pytest.mark.parametrize("moves", [[1e-3, 0, 0], [0, 2e-3, 0], [0, 0, 1e-3]])
def test_a_pinholes_images_move_by_its_focal_length_over_the_depth(moves):
    camera = Camera("a", (40, 30), [[800.0, 0, 20], [0, 900.0, 15], [0, 0, 1]])
    points = np.array([[0.1, -0.2, 5.0], [0.3, 0.1, 8.0]])
    x, y, z = points.T
    dx, dy, dz = moves
    expected = np.stack([800 * (dx - x / z * dz) / z, 900 * (dy - y / z * dz) / z], axis=1)
    np.testing.assert_allclose(image_motion(camera, points, np.array(moves)), expected, atol=1e-7)
    each = image_motion(camera, points, np.tile(moves, (2, 1)))
    np.testing.assert_array_equal(each, image_motion(camera, points, np.array(moves)))
