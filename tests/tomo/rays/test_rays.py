from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import rigs
from tomo.rays import Rays


@pytest.fixture(scope="module")
def camera():
    return rigs.Camera(
        "cam", (8, 6), [[90, 0, 3.2], [0, 80, 2.6], [0, 0, 1]],
        rigs.Distortion("brown", [-0.2, 0.05, 0.001, -0.002]), np.eye(3), [1, 2, 30],
    )  # fmt: skip


@pytest.fixture(scope="module")
def folded():
    """A camera whose lens maps the corners of the image from no direction at all."""
    return rigs.Camera(
        "folded", (20, 20), [[10, 0, 9.5], [0, 10, 9.5], [0, 0, 1]],
        rigs.Distortion("brown", [-0.3, 0, 0, 0]), np.eye(3), [0, 0, 0],
    )  # fmt: skip


@pytest.mark.parametrize("supersample", [1, 2, 5])
def test_weights_of_a_pixel_sum_to_one(camera, supersample):
    rays = Rays.from_camera(camera, supersample=supersample)
    assert rays.n_pixels == 48
    np.testing.assert_array_equal(np.diff(rays.pixel_ptr), supersample**2)
    np.testing.assert_allclose(np.add.reduceat(rays.weight, rays.pixel_ptr[:-1]), 1, rtol=1e-14)


def test_one_ray_a_pixel_looks_along_its_centre(camera):
    rays = Rays.from_camera(camera)
    origins, directions = camera.rays()
    np.testing.assert_array_equal(rays.origins, origins)
    np.testing.assert_array_equal(rays.directions, directions)
    assert (rays.lengths == np.inf).all()


@pytest.mark.parametrize("supersample", [1, 3])
def test_without_distortion_the_compiled_rays_are_the_cameras(supersample):
    matrix = [[900.0, 3.5, 3.2], [0, 870.0, 2.9], [0, 0, 1]]
    R, t = rigs.look_at([31, 17, -25], [0.3, -0.2, 0.1], up=(0.2, 1, 0.1))
    pinhole = rigs.Camera("p", (8, 6), matrix, R=R, t=t)
    pixels = np.array([47, 0, 13, 13])
    rays = Rays.from_camera(pinhole, pixels, supersample)
    steps = (np.arange(supersample) + 0.5) / supersample - 0.5
    row, column = np.divmod(pixels, 8)
    down, right = (a.ravel() for a in np.meshgrid(steps, steps, indexing="ij"))
    uv = np.stack([column[:, None] + right, row[:, None] + down], axis=-1)
    origins, directions = pinhole.rays(uv.reshape(-1, 2))
    np.testing.assert_array_equal(rays.origins, origins)
    np.testing.assert_allclose(rays.directions, directions, rtol=0, atol=4e-16)


@pytest.mark.parametrize("supersample", [2, 3])
def test_rays_sit_at_the_centres_of_equal_squares_of_their_pixel(camera, supersample):
    rays = Rays.from_camera(camera, supersample=supersample)
    uv, _, valid = camera.project(rays.origins + 25 * rays.directions)
    assert valid.all()
    uv = uv.reshape(6, 8, supersample, supersample, 2)
    column, row = np.meshgrid(np.arange(8), np.arange(6))
    steps = (np.arange(supersample) + 0.5) / supersample - 0.5
    expected_u = column[:, :, None, None] + steps[None, None, None, :]
    expected_v = row[:, :, None, None] + steps[None, None, :, None]
    np.testing.assert_allclose(uv[..., 0], np.broadcast_to(expected_u, uv.shape[:-1]), atol=1e-6)
    np.testing.assert_allclose(uv[..., 1], np.broadcast_to(expected_v, uv.shape[:-1]), atol=1e-6)


def rows(rays):
    """Return the pieces of every pixel."""
    parts = (rays.origins, rays.directions, rays.lengths[:, None], rays.weight[:, None])
    pieces = np.concatenate(parts, axis=1)
    return [pieces[start:stop] for start, stop in pairwise(rays.pixel_ptr)]


@pytest.mark.parametrize("supersample", [1, 3])
@pytest.mark.parametrize("pixels", [[], [0], [47, 3, 3, 12], range(40, 48)])
@pytest.mark.parametrize("name", ["camera", "folded"])
def test_some_pixels_are_the_whole_images_rows(request, name, pixels, supersample):
    camera = request.getfixturevalue(name)
    pixels = np.array(pixels, np.int64)
    some = Rays.from_camera(camera, pixels, supersample)
    whole = rows(Rays.from_camera(camera, supersample=supersample))
    assert some.n_pixels == len(pixels)
    expected = [whole[p] for p in pixels]
    for found, row in zip(rows(some), expected, strict=True):
        # The lens is inverted by iteration, in blocks: the last bit may depend on the company.
        np.testing.assert_allclose(found, row, rtol=0, atol=1e-12)


@pytest.mark.parametrize("supersample", [1, 4])
def test_a_pixel_seen_from_nowhere_keeps_its_row_and_owns_no_ray(folded, supersample):
    rays = Rays.from_camera(folded, supersample=supersample)
    counts = np.diff(rays.pixel_ptr)
    assert rays.n_pixels == 400
    assert counts[0] == counts[-1] == 0
    assert (counts == supersample**2).sum() > 100
    if supersample > 1:  # pixels that the fold cuts: the mean is over what is seen
        assert ((counts > 0) & (counts < supersample**2)).any()
    seen = np.flatnonzero(counts)
    sums = np.bincount(np.repeat(np.arange(400), counts), rays.weight, 400)
    np.testing.assert_allclose(sums[seen], 1, rtol=1e-14)
    assert np.isfinite(rays.directions).all()


@given(st.lists(st.lists(st.integers(0, 3), max_size=5), min_size=1, max_size=4))
def test_concatenate_puts_parts_one_after_another(parts):
    rng = np.random.default_rng(0)

    def make(counts):
        n = sum(counts)
        directions = rng.standard_normal((n, 3)) + np.array([9, 0, 0])
        directions /= np.linalg.norm(directions, axis=1, keepdims=True)
        ptr = np.cumsum([0, *counts]).astype(np.int64)
        return Rays(rng.random((n, 3)), directions, rng.random(n), rng.random(n), ptr)

    made = [make(counts) for counts in parts]
    whole = Rays.concatenate(made)
    np.testing.assert_array_equal(np.diff(whole.pixel_ptr), np.concatenate(parts))
    for name in ("origins", "directions", "lengths", "weight"):
        expected = np.concatenate([getattr(part, name) for part in made])
        np.testing.assert_array_equal(getattr(whole, name), expected)


def test_paths_go_with_their_pixels():
    plain = Rays.from_lines(np.arange(18.0).reshape(6, 3), [0, 0, 1])
    pixel_ptr, path_ptr = np.array([0, 3, 3, 4, 6]), np.array([0, 1, 3, 4, 6])
    rays = replace(plain, pixel_ptr=pixel_ptr, path_ptr=path_ptr)
    some = rays.take(np.array([3, 1, 0]))
    np.testing.assert_array_equal(some.pixel_ptr, [0, 2, 2, 5])
    np.testing.assert_array_equal(some.path_ptr, [0, 2, 3, 5])
    np.testing.assert_array_equal(some.origins[:, 0], [12, 15, 0, 3, 6])
    both = Rays.concatenate([plain.take(np.array([5, 4])), some])
    np.testing.assert_array_equal(both.path_ptr, [0, 1, 2, 4, 5, 7])
    np.testing.assert_array_equal(plain.paths, np.arange(7))
    assert plain.take(np.array([1])).path_ptr is None


def test_from_lines_normalises_and_repeats():
    rays = Rays.from_lines([1, 2, 3], [[0, 0, 5], [3, 4, 0]], 7)
    np.testing.assert_allclose(rays.directions, [[0, 0, 1], [0.6, 0.8, 0]])
    np.testing.assert_array_equal(rays.origins, [[1, 2, 3], [1, 2, 3]])
    np.testing.assert_array_equal(rays.lengths, [7, 7])
    np.testing.assert_array_equal(rays.pixel_ptr, [0, 1, 2])
    assert len(Rays.from_lines([0, 0, 0], [0, 0, 1], [1, 2, 3])) == 3
    assert len(Rays.from_lines(np.zeros((4, 3)), [0, 0, 1])) == 4
    assert len(Rays.from_lines(np.zeros((0, 3)), np.zeros((0, 3)))) == 0


def parts(**changed):
    plain = {
        "origins": np.zeros((2, 3)),
        "directions": np.eye(3)[:2],
        "lengths": np.ones(2),
        "weight": np.ones(2),
        "pixel_ptr": np.arange(3),
    }
    return plain | changed


@pytest.mark.parametrize(
    ("changed", "message"),
    [
        ({"origins": np.zeros((2, 2))}, "rays origins: found"),
        ({"origins": np.zeros((2, 3), np.float32)}, "rays origins: found float32"),
        ({"origins": np.full((2, 3), np.nan)}, "rays origins: found NaN"),
        ({"directions": 2 * np.eye(3)[:2]}, "rays directions: expected unit"),
        ({"directions": np.full((2, 3), np.nan)}, "rays directions: expected unit"),
        ({"lengths": np.array([1.0, -1.0])}, "rays lengths: found a negative"),
        ({"lengths": np.array([1.0, np.nan])}, "rays lengths: found a negative or NaN"),
        ({"weight": np.ones(3)}, "rays weight: found"),
        ({"pixel_ptr": np.array([0, 1, 3])}, "rays pixel_ptr: expected"),
        ({"pixel_ptr": np.array([1, 2])}, "rays pixel_ptr: expected"),
        ({"pixel_ptr": np.arange(3, dtype=np.int32)}, "rays pixel_ptr: expected"),
        ({"path_ptr": np.array([0, 2])}, "rays path_ptr: found a path in two pixels"),
        ({"path_ptr": np.array([0, 1])}, "rays path_ptr: found a path in two pixels"),
        ({"path_ptr": np.array([0, 1, 1, 2])}, "rays path_ptr: expected int64 numbers that inc"),
    ],
)
def test_bad_parts_are_named(changed, message):
    Rays(**parts())
    with pytest.raises(ValueError, match=message):
        Rays(**parts(**changed))


@pytest.mark.parametrize("size", [5e-324, 1e-310, 1e-200, 1e200, 1.7e308])
def test_directions_of_any_length_are_normalised(size):
    rays = Rays.from_lines([0, 0, 0], [[size, 0, 0], [size, -size, size]])
    expected = [[1, 0, 0], np.array([1, -1, 1]) / np.sqrt(3)]
    np.testing.assert_allclose(rays.directions, expected, rtol=1e-15)


def test_bad_lines_are_named(camera):
    for bad in (np.nan, np.inf):
        with pytest.raises(ValueError, match="directions: found NaN or infinity"):
            Rays.from_lines([0, 0, 0], [1, bad, 0])
    with pytest.raises(ValueError, match="found a zero vector"):
        Rays.from_lines([0, 0, 0], [0, 0, 0])
    with pytest.raises(ValueError, match="supersample: found 0"):
        Rays.from_camera(camera, supersample=0)
