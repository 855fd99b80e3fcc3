import numpy as np
import pytest

from rigs import Camera, Distortion
from tomo.view.ray_table import RayTable

BROWN = Distortion("brown", (-0.25, 0.08, 1e-3, -2e-3, 0.01))


def camera(distortion=None, focal=700.0):
    K = [[focal, 3.0, 411.0], [0, 1.1 * focal, 290.0], [0, 0, 1]]
    return Camera("c", (800, 600), K, distortion or Distortion(), t=[1.0, 2.0, 3.0])


@pytest.mark.parametrize(
    ("distortion", "focal"),
    [
        (None, 700.0),
        (BROWN, 700.0),
        (BROWN, 450.0),
        (Distortion("fisheye", (0.02, -0.01, 0.0, 0.0)), 400.0),
        (Distortion("rational", (-0.3, 0.1, 0.001, 0.001, 0.02, -0.1, 0.03, 0.01)), 900.0),
    ],
)
def test_directions_are_the_camera_s_to_a_twentieth_of_a_pixel(distortion, focal):
    seen = camera(distortion, focal)
    table = RayTable.of(seen)
    uv = np.random.default_rng(0).uniform(-0.5, [799.5, 599.5], (4000, 2))
    true = seen.rays(uv)[1]
    off = np.linalg.norm(np.cross(table.directions(uv), true), axis=1)
    assert (table.directions(uv) * true).sum(axis=1).min() > 0
    assert off.max() * 1.1 * focal < 0.06
    np.testing.assert_allclose(np.linalg.norm(table.directions(uv), axis=1), 1)


def test_a_pinhole_needs_the_smallest_table_and_is_exact():
    table = RayTable.of(camera())
    assert table.nodes.shape == (4, 4, 3)
    uv = np.random.default_rng(1).uniform(-0.5, [799.5, 599.5], (100, 2))
    np.testing.assert_allclose(table.directions(uv), camera().rays(uv)[1], atol=1e-13)


def test_where_the_lens_maps_nothing_there_is_no_direction():
    seen = camera(Distortion("brown", (-0.25, 0, 0, 0)), 100.0)
    uv = np.random.default_rng(2).uniform(-0.5, [799.5, 599.5], (2000, 2))
    maps = np.isfinite(seen.rays(uv)[1]).all(axis=1)
    found = np.isfinite(RayTable.of(seen).directions(uv)).all(axis=1)
    assert 0.02 < maps.mean() < 0.98
    assert not (found & ~maps).any() or (found & ~maps).mean() < 0.01
    assert found.sum() > 0.7 * maps.sum()  # a cell along the lens's border is lost
