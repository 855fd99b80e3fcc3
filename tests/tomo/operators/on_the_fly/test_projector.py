"""The projector without a matrix is the stored one, to rounding, and its own transpose."""

from dataclasses import replace

import numba
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from rigs import Camera, Distortion, ring
from tomo import Projector, Rays, VoxelGrid, dot_test
from tomo.grid import ActiveVoxels
from tomo.operators.on_the_fly import OnTheFlyProjector, projector
from tomo.operators.on_the_fly.camera_sources import pixel_source
from tomo.trace import trace

GRIDS = [
    VoxelGrid((12, 9, 7), 1.0),
    VoxelGrid((1, 30, 5), (0.5, 2.0, 0.1), (3, -4, 5)),
    VoxelGrid((40, 1, 1), 0.25),
    VoxelGrid((6, 6, 6), 1e-6, (1.0, 2.0, 3.0)),
]


def random_rays(grid, count, seed):
    """Rays through the box from near, far and within, an axis-parallel tenth among them."""
    random = np.random.default_rng(seed)
    target = random.uniform(grid.lower, grid.upper, (count, 3))
    away = random.normal(size=(count, 3))
    away /= np.linalg.norm(away, axis=1, keepdims=True)
    away[: count // 10] = np.eye(3)[random.integers(0, 3, count // 10)]
    distance = grid.extent.max() * 10 ** random.uniform(-1, 4, (count, 1))
    return Rays.from_lines(target + away * distance, -away)


@pytest.fixture(params=range(len(GRIDS)), ids=lambda n: str(GRIDS[n].shape))
def pair(request):
    grid = GRIDS[request.param]
    rays = random_rays(grid, 2000, request.param)
    view_ptr = [0, 700, 700, 2000]
    stored = Projector(trace(rays, grid, "reference", dtype=np.float64), grid, view_ptr)
    return stored, OnTheFlyProjector(rays, grid, view_ptr)


def test_same_matrix_in_double_precision(pair):
    stored, flying = pair
    random = np.random.default_rng(1)
    x, y = random.normal(size=stored.shape[1]), random.normal(size=stored.shape[0])
    scale = stored.row_sums.max()
    assert np.abs(flying @ x - stored @ x).max() < 1e-9 * scale
    back = stored.T @ y
    assert np.abs(flying.T @ y - back).max() < 1e-9 * np.abs(back).max()


def test_lengths_of_every_voxel(pair):
    stored, flying = pair
    matrix = stored.to_scipy()
    errors = []
    for voxel in np.random.default_rng(2).integers(0, stored.shape[1], 40):
        unit = np.zeros(stored.shape[1], np.float32)
        unit[voxel] = 1
        exact = matrix[:, [voxel]].toarray().ravel()
        errors.append((flying @ unit - exact) / max(stored.grid.spacing))
    # a face passed at a grazing angle is found less well, but by few rays
    assert np.abs(errors).max() < 1e-4
    assert np.sqrt(np.mean(np.square(errors))) < 1e-6


@given(seed=st.integers(0, 2**31), shape=st.tuples(*[st.integers(1, 9)] * 3))
def test_random_grids(seed, shape):
    random = np.random.default_rng(seed)
    grid = VoxelGrid(shape, tuple(random.uniform(0.2, 3, 3)), tuple(random.normal(size=3)))
    rays = random_rays(grid, 60, seed)
    stored = Projector(trace(rays, grid, "reference", dtype=np.float64), grid)
    x = random.normal(size=grid.size)
    difference = np.abs(OnTheFlyProjector(rays, grid) @ x - stored @ x)
    assert difference.max() < 1e-9 * grid.extent.sum() * np.abs(x).max()


def test_rays_along_faces_are_counted_once():
    grid = VoxelGrid((4, 4, 4), 1.0, (2, 2, 2))
    faces = np.arange(5.0)
    y, z = (a.ravel() for a in np.meshgrid(faces, faces))
    rays = Rays.from_lines(np.stack([np.full(25, -3.0), y, z], 1), [1.0, 0, 0])
    stored = Projector(trace(rays, grid, "reference"), grid)
    flying = OnTheFlyProjector(rays, grid)
    x = np.random.default_rng(0).random(64)
    assert flying @ x == pytest.approx(stored @ x, rel=1e-12)


def test_rays_that_miss_or_end_early():
    grid = VoxelGrid((4, 4, 4), 1.0)
    rays = Rays.from_lines([[-9, 0.5, 0.5], [-9, 50, 0], [0, 0.5, 0.5]], [1.0, 0, 0], [8, 99, 1])
    assert (OnTheFlyProjector(rays, grid) @ np.ones(64)).tolist() == [1.0, 0.0, 1.0]


def test_views_and_pixels(pair):
    stored, flying = pair
    x = np.random.default_rng(3).random(stored.shape[1])
    whole = flying @ x
    assert np.array_equal(flying.view(2) @ x, whole[700:])
    assert np.array_equal(flying.subset([2, 1, 0]) @ x, np.r_[whole[700:], whole[:700]])
    assert flying.subset([2, 1, 0]).view_ptr.tolist() == [0, 1300, 1300, 2000]
    some = np.arange(5, 2000, 7)
    assert np.array_equal(flying.take(some) @ x, whole[some])
    assert flying.n_segments == pytest.approx(stored.n_segments, rel=1e-3)


def test_several_rays_a_pixel_are_averaged():
    grid = GRIDS[0]
    one = random_rays(grid, 300, 5)
    weight = np.full(300, 1 / 3)
    grouped = Rays(one.origins, one.directions, one.lengths, weight, np.arange(0, 301, 3))
    x = np.random.default_rng(4).random(grid.size)
    means = (OnTheFlyProjector(one, grid) @ x).reshape(-1, 3).mean(axis=1)
    assert OnTheFlyProjector(grouped, grid) @ x == pytest.approx(means, rel=1e-12)
    assert dot_test(OnTheFlyProjector(grouped, grid)) < 1e-12


def test_places_too_large_for_32_bits_give_the_same_bits(pair, monkeypatch):
    _, flying = pair
    random = np.random.default_rng(8)
    x, y = (random.random(n).astype(np.float32) for n in flying.shape[::-1])
    images, volume = flying @ x, flying.T @ y
    monkeypatch.setattr(OnTheFlyProjector, "_index_of", np.zeros(0, np.int64))
    assert np.array_equal(flying @ x, images)
    assert np.array_equal(flying.T @ y, volume)


def test_same_bits_on_any_number_of_threads(pair, on_threads):
    _, flying = pair
    random = np.random.default_rng(6)
    x = random.random(flying.shape[1]).astype(np.float32)
    y = random.random(flying.shape[0]).astype(np.float32)
    results = []
    for threads in range(1, numba.config.NUMBA_NUM_THREADS + 1):
        with on_threads(threads):
            results.append((flying @ x, flying.T @ y))
    for images, volume in results[1:]:
        assert np.array_equal(images, results[0][0])
        assert np.array_equal(volume, results[0][1])


@pytest.mark.parametrize("slope", [(1, 1, 0), (1, 1, 0.2), (1, -1, 0), (-1, 1, 1), (0.5, 1, -1)])
@pytest.mark.parametrize("beside", [-(2.0**-53), 0.0, 2.0**-52, -(2.0**-24), 2.0**-23])
def test_diagonal_rays_beside_edges(slope, beside):
    grid = VoxelGrid((4, 4, 4), 1.0, (2, 2, 2))
    starts = [(0, 1 + beside, 1.5), (0, 3 + beside, 2 - beside), (4 + beside, 2, 1 + beside)]
    rays = Rays.from_lines(np.subtract(starts, np.multiply(9.0, slope)), slope)
    stored = Projector(trace(rays, grid, "reference", dtype=np.float64), grid)
    flying = OnTheFlyProjector(rays, grid)
    bounds = {np.float64: 1e-12, np.float32: 1e-5}
    if 0 < abs(beside) < 2.0**-24:  # single precision cannot tell on which side of the edge
        del bounds[np.float32]
    for dtype, bound in bounds.items():
        for voxel in range(grid.size):
            unit = np.zeros(grid.size, dtype)
            unit[voxel] = 1
            assert np.abs(flying @ unit - stored @ unit).max() < bound


def test_a_piece_too_short_to_move_leaves_no_trace():
    grid = VoxelGrid((4, 4, 4), 1.0)
    flying = OnTheFlyProjector(Rays.from_lines([0.3, 0.4, 0.5], [1.0, 0, 0], 1e-20), grid)
    assert (flying @ np.ones(64)).tolist() == [0.0]
    assert not (flying.T @ np.ones(1)).any()


WIDE = Distortion("brown", (-0.3, 0.12, 1e-3, -2e-3, 0.01))
LENSES = {"pinhole": Distortion(), "brown": WIDE, "fisheye": Distortion("fisheye", (0.1, 0, 0, 0))}


def cameras_and_rays(lens, pixels=None, supersample=1):
    grid = VoxelGrid((14, 11, 17), (0.5, 0.7, 0.4), (0.3, -0.2, 0.1))
    rig = ring(3, 50.0, 60.0, image_size=(31, 23), footprint=0.4, pitch_degrees=[0, 20, -50])
    cameras = [replace(camera, distortion=LENSES[lens]) for camera in rig]
    rays = Rays.concatenate(
        Rays.from_camera(camera, None if pixels is None else pixels[v], supersample)
        for v, camera in enumerate(cameras)
    )
    return cameras, grid, rays


@pytest.mark.parametrize("lens", LENSES)
@pytest.mark.parametrize("supersample", [1, 3])
def test_rays_of_cameras_are_the_stored_ones(lens, supersample):
    random = np.random.default_rng(7)
    pixels = [np.sort(random.choice(31 * 23, 300, replace=False)) for _ in range(3)]
    cameras, grid, rays = cameras_and_rays(lens, pixels, supersample)
    made = OnTheFlyProjector(
        [pixel_source(*one, supersample) for one in zip(cameras, pixels, strict=True)], grid
    )
    kept = OnTheFlyProjector(rays, grid, made.view_ptr)
    x = random.random(grid.size)
    expected = kept @ x
    assert expected.max() > 1
    bound = 1e-6 if lens == "brown" else 1e-10  # its bend is kept in single precision
    assert np.abs(made @ x - expected).max() < bound * expected.max()
    assert made.n_segments == pytest.approx(kept.n_segments, rel=1e-4)
    assert dot_test(made) < 1e-12
    some = np.sort(random.choice(900, 211, replace=False))
    assert np.array_equal(made.take(some) @ x, (made @ x)[some])
    assert np.array_equal(made.subset([2, 0]) @ x, np.r_[(made @ x)[600:], (made @ x)[:300]])
    assert np.array_equal(made.rows(250, 700).rows(10, 400) @ x, (made @ x)[260:650])
    assert np.array_equal(made.take(some).take(np.arange(5, 99, 3)) @ x, (made @ x)[some[5:99:3]])


def test_pixels_that_the_lens_does_not_reach_see_nothing():
    grid = VoxelGrid((10, 10, 10), 8.0)
    camera = Camera(
        "wide", (40, 40), [[12, 0, 19.5], [0, 12, 19.5], [0, 0, 1]],
        Distortion("brown", (-0.3, 0, 0, 0)), t=[0, 0, 50],
    )  # fmt: skip
    rays = Rays.from_camera(camera, supersample=2)
    partly = np.diff(rays.pixel_ptr)
    assert 0 in partly
    assert set(partly) & {1, 2, 3}
    x = np.random.default_rng(9).random(grid.size)
    made = OnTheFlyProjector([pixel_source(camera, None, 2)], grid) @ x
    assert made == pytest.approx(OnTheFlyProjector(rays, grid) @ x, rel=1e-5, abs=1e-5)


@pytest.mark.parametrize("chunk", [0.002, 0.1])
def test_voxels_that_are_not_live_count_as_zeros(chunk):
    grid = VoxelGrid((37, 60, 41), 1.0)
    rays = random_rays(grid, 3000, 11)
    random = np.random.default_rng(12)
    mask = np.zeros(grid.shape, bool)
    if chunk < 0.01:  # specks
        mask.ravel()[random.choice(grid.size, int(chunk * grid.size), replace=False)] = True
    else:  # a block at the rim
        mask[20:, :25, 30:] = True
    active = ActiveVoxels.from_mask(grid, mask)
    whole = OnTheFlyProjector(rays, grid)
    part = OnTheFlyProjector(rays, grid, active=active)
    for dtype in (np.float32, np.float64):
        x = random.random(active.size).astype(dtype)
        y = random.random(3000).astype(dtype)
        assert np.array_equal(part @ x, whole @ active.expand(x))
        assert np.array_equal(part.T @ y, active.compress(whole.T @ y))
    assert part.shape == (3000, active.size)
    assert dot_test(part.take(np.arange(0, 3000, 2))) < 1e-12


def test_many_ranges_of_columns_add_up_to_the_same_bits(pair, monkeypatch):
    _, flying = pair
    y = np.random.default_rng(13).random(flying.shape[0]).astype(np.float32)
    once = flying.T @ y
    monkeypatch.setattr(numba, "set_num_threads", lambda threads: None)  # that many there are not
    for parts in (2, 3, 7, 40):
        monkeypatch.setattr(numba, "get_num_threads", lambda parts=parts: parts)
        assert np.array_equal(flying.T @ y, once)
    monkeypatch.setattr(projector, "DIFFERENCES", 0)  # one after another, too
    assert np.array_equal(flying.T @ y, once)


def test_voxels_that_no_ray_meets_get_nothing():
    grid = VoxelGrid((20, 20, 20), 1.0)
    rays = random_rays(grid, 50, 14)
    seen = Projector(trace(rays, grid, "reference", dtype=np.float64), grid).column_sums
    y = np.random.default_rng(15).normal(size=50)
    back = OnTheFlyProjector(rays, grid).T @ y
    assert (seen == 0).sum() > 1000
    assert not back[seen == 0].any()
    assert back[seen > 1e-6].all()


def test_faint_beside_bright_is_good_to_single_precision_of_the_bright():
    grid = VoxelGrid((40, 40, 40), 1.0)
    rays = random_rays(grid, 500, 16)
    volume = np.full(grid.shape, 1e-3, np.float32)
    volume[18:22, 18:22, 18:22] = 100
    flying = OnTheFlyProjector(rays, grid)
    exact = flying @ volume.ravel().astype(np.float64)
    assert np.abs(flying @ volume.ravel() - exact).max() < 3e-6 * 400


@pytest.mark.parametrize("dtype", [np.float32, np.float64])
@pytest.mark.parametrize("values", [(np.nan,), (np.inf,), (-np.inf,), (np.inf, -np.inf)])
def test_pixels_that_are_not_finite_reach_the_voxels_that_they_see_alone(values, dtype):
    grid = VoxelGrid((6, 7, 8), 1.0)
    rays = random_rays(grid, 40, 17)
    flying, stored = OnTheFlyProjector(rays, grid), Projector(trace(rays, grid), grid)
    y = np.ones(40, dtype)
    y[3 : 3 + len(values)] = values
    found, expected = flying.T @ y, stored.T @ y
    assert found.dtype == dtype
    assert 0 < np.isfinite(found).sum() < grid.size
    np.testing.assert_allclose(found, expected, rtol=1e-5)  # what is not finite alike


@pytest.mark.parametrize("scale", [1e-295, 1e-40, 1e30, 1e290])
def test_back_projections_of_the_faintest_and_the_brightest_images_scale(scale):
    grid = VoxelGrid((4, 4, 4), 1.0)
    flying = OnTheFlyProjector(random_rays(grid, 20, 17), grid)
    found = flying.T @ np.full(20, scale)
    np.testing.assert_allclose(found / scale, flying.T @ np.ones(20), rtol=1e-9)
