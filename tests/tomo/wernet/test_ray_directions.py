import numpy as np
import pytest

from tomo import Rays
from tomo.trace import Segments
from tomo.wernet.ray_directions import ray_directions


def _segments(*rays):
    """Return segments of rays given by their midpoints."""
    counts = [len(ray) for ray in rays]
    midpoint = np.array([m for ray in rays for m in ray], np.float32).reshape(-1, 3)
    ptr = np.cumsum([0, *counts])
    return Segments(ptr, np.zeros(ptr[-1], np.int32), np.ones(ptr[-1], np.float32), midpoint)


ALONG_X, ALONG_Z = [(0, 0, 0), (1, 0, 0), (2, 0, 0)], [(0, 0, 3), (0, 0, 1)]


def test_directions_are_those_of_the_cameras_rays(scene):
    one = scene()
    views = [one.projector.view(number) for number in range(len(one.rig))]
    found = np.concatenate([ray_directions(view.segments) for view in views])
    true = np.concatenate(
        [
            Rays.from_camera(c, p).directions
            for c, p in zip(one.rig, one.system.pixels, strict=True)
        ]
    )
    count = np.diff(one.projector.segments.ptr)
    many = count >= 8
    assert many.sum() > 1000
    np.testing.assert_allclose(found[many], true[many], atol=1e-5)
    np.testing.assert_allclose(np.linalg.norm(found, axis=1), 1, rtol=1e-12)
    # a pixel with a single crossing has that of one near in number: in the image, at least
    across = one.rig[0].image_size[0] / one.rig[0].camera_matrix[0, 0]
    assert np.linalg.norm(found - true, axis=1).max() < across


def test_vectors_point_away_from_the_camera_and_have_length_one():
    np.testing.assert_array_equal(
        ray_directions(_segments(ALONG_X, ALONG_Z)), [[1, 0, 0], [0, 0, -1]]
    )


@pytest.mark.parametrize(
    "short",
    [[(5, 5, 5)], [], [(5, 5, 5), (5, 5, 5)], [(5, 5, 5), (5, 5.0001, 5)]],
    ids=["one crossing", "none", "twice the same", "too near"],
)
def test_what_gives_no_direction_takes_the_nearest_pixel_s(short):
    found = ray_directions(_segments(ALONG_X, short, short, short, ALONG_Z, short))
    x, z = [1, 0, 0], [0, 0, -1]
    assert found[1].tolist() == x
    assert found[2].tolist() in (x, z)  # half way
    assert [row.tolist() for row in found[3:]] == [z, z, z]
    found = ray_directions(_segments(short, ALONG_Z))
    assert found.tolist() == [z, z]


def test_without_any_direction_all_are_zero():
    for rays in ([[(1, 2, 3)], [(4, 5, 6)]], [[], []], [[(0, 0, 0), (0, 0, 0)]]):
        assert not ray_directions(_segments(*rays)).any()
