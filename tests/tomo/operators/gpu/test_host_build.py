"""The kernels, compiled for the host, against the float64 oracle; their bits in any order."""

from dataclasses import replace

import numpy as np
import pytest

import rigs
from tomo.grid import ActiveVoxels, VoxelGrid
from tomo.operators import Absorption, Projector, dot_test
from tomo.operators.gpu import DeviceMatrix, DeviceProjector
from tomo.operators.on_the_fly import AttenuatedProjector, OnTheFlyProjector
from tomo.operators.on_the_fly.camera_sources import pixel_source
from tomo.rays import Rays
from tomo.trace import trace

GRIDS = {
    "exact in binary": VoxelGrid((6, 9, 5), 0.5, (1, 2, 3)),
    "rounded, off the origin": VoxelGrid((7, 4, 8), (0.1, 0.3, 0.7), (100, -33.3, 7.7)),
    "thin": VoxelGrid((1, 12, 7), (0.25, 1, 0.4)),
    "one voxel": VoxelGrid((1, 1, 1), 2.0, (1, 1, 1)),
}
COUNT = 60


def corners(grid, rng, outer):
    number = np.stack([rng.choice([0, n] if outer else n + 1, COUNT) for n in grid.shape], axis=1)
    return np.where(number == grid.shape, grid.upper, grid.lower + number * grid.spacing)


def with_zeros(rng):
    """Return directions in planes and along axes."""
    directions = rng.standard_normal((COUNT, 3))
    directions[rng.random((COUNT, 3)) < 0.5] = 0
    directions[(directions == 0).all(axis=1)] = [0, -1, 0]
    return directions


def rays_of(kind, grid):
    rng = np.random.default_rng(3)
    anywhere = rng.uniform(grid.lower, grid.upper, (COUNT, 3))
    steps = rng.integers(-1, 2, (COUNT, 3)) * np.array(grid.spacing)
    steps[(steps == 0).all(axis=1)] = [1, 0, 0]
    free = rng.standard_normal((COUNT, 3))
    points, ways, lengths = {
        "free": (anywhere - 50 * free, free, np.inf),
        "from inside, finite": (anywhere, free, rng.uniform(0, 3, COUNT)),
        "in faces and along edges": (corners(grid, rng, False), with_zeros(rng), np.inf),
        "on outer faces": (corners(grid, rng, True), with_zeros(rng), np.inf),
        "nearly parallel to faces": (
            corners(grid, rng, False),
            np.eye(3)[rng.integers(0, 3, COUNT)]
            + 10.0 ** rng.uniform(-330, -14, (COUNT, 1)) * rng.choice([-1, 0, 1], (COUNT, 3)),
            np.inf,
        ),
        "from corner to corner": (corners(grid, rng, False) - 64 * steps, steps, np.inf),
        "missing, of no length": (anywhere - 50 * free, free * rng.choice([-1, 1], (COUNT, 1)), 1),
    }[kind]
    return Rays.from_lines(points, ways, lengths)


KINDS = (
    "free", "from inside, finite", "in faces and along edges", "on outer faces",
    "nearly parallel to faces", "from corner to corner", "missing, of no length",
)  # fmt: skip


@pytest.fixture(params=GRIDS, scope="module")
def grid(request):
    return GRIDS[request.param]


def oracle_of(rays, grid, **how):
    return Projector(trace(rays, grid, "reference", dtype=np.float64), grid, **how)


def rows_of(operator):
    """Return the matrix, row by row, from the adjoint of single pixels."""
    return (operator.T @ np.eye(operator.shape[0])).T


@pytest.mark.parametrize("kind", KINDS)
def test_the_same_voxels_and_lengths_as_the_oracle(grid, kind, host):
    rays, edge = rays_of(kind, grid), min(grid.spacing)
    found = rows_of(DeviceProjector(OnTheFlyProjector(rays, grid), host))
    exact = oracle_of(rays, grid).to_scipy().toarray()
    assert np.array_equal(found > 1e-10 * edge, exact > 1e-10 * edge)
    assert np.abs(found - exact).max() < 1e-11 * edge


@pytest.fixture(scope="module")
def scene():
    """Rays of three cameras through a grid, four a pixel, those of one in a lens that bends."""
    grid = VoxelGrid((12, 16, 9), (1.0, 0.8, 1.2), (3.0, -2.0, 1.0))
    rig = rigs.ring(3, distance=120.0, image_size=(20, 24), footprint=1.1, center=grid.center)
    rays = Rays.concatenate([Rays.from_camera(camera, supersample=2) for camera in rig])
    return grid, rays, [0, 480, 960, 1440]


@pytest.fixture(scope="module")
def operators(scene, host):
    grid, rays, view_ptr = scene
    flying = OnTheFlyProjector(rays, grid, view_ptr)
    return DeviceProjector(flying, host), oracle_of(rays, grid, view_ptr=view_ptr)


def test_products_in_single_precision(operators):
    found, oracle = operators
    random = np.random.default_rng(1)
    x = random.random(found.shape[1], np.float32)
    y = (random.normal(size=found.shape[0]) * 10 ** random.uniform(-6, 0, found.shape[0])).astype(
        np.float32
    )
    images, exact = found @ x, oracle @ x.astype(np.float64)
    assert images.dtype == np.float32
    assert np.linalg.norm(images - exact) < 1e-6 * np.linalg.norm(exact)
    volume, exact = found.T @ y, oracle.T @ y.astype(np.float64)
    assert volume.dtype == np.float32
    assert np.linalg.norm(volume - exact) < 3e-6 * np.linalg.norm(exact)


def test_dim_pixels_beside_bright_ones_keep_their_digits(operators):
    """Whole numbers are fine enough for pixels 1e6 times dimmer than the brightest."""
    found, oracle = operators
    y = np.full(found.shape[0], 1e-6)
    y[0] = 1.0
    far = oracle.T @ np.eye(found.shape[0])[0] == 0
    assert far.sum() > 100
    exact = oracle.T @ y
    np.testing.assert_allclose((found.T @ y)[far], exact[far], rtol=1e-9, atol=1e-20)


@pytest.mark.parametrize(("dtype", "bound"), [(np.float64, 1e-12), (np.float32, 1e-6)])
def test_dot_test(operators, dtype, bound):
    found, _ = operators
    for part in (found, found.subset([2, 0]), found.rows(100, 900)):
        assert dot_test(part, 1, dtype) < bound


def test_the_bits_do_not_depend_on_the_order_of_threads(scene, operators, shuffled):
    grid, rays, view_ptr = scene
    found, _ = operators
    other = DeviceProjector(OnTheFlyProjector(rays, grid, view_ptr), shuffled)
    random = np.random.default_rng(2)
    for dtype in (np.float32, np.float64):
        x, y = random.random(found.shape[1]).astype(dtype), random.normal(size=1440).astype(dtype)
        assert np.array_equal(found @ x, other @ x)
        assert np.array_equal(found.T @ y, other.T @ y)
        assert np.array_equal(found.T @ y, found.T @ y)


def test_columns_together_are_those_one_by_one(operators):
    found, _ = operators
    random = np.random.default_rng(3)
    x, y = random.random((found.shape[1], 6)), random.normal(size=(1440, 6))
    y *= 10.0 ** np.arange(-3, 3)
    images, volumes = found @ x, found.T @ y
    for column in range(6):
        assert np.array_equal(images[:, column], found @ x[:, column])
        assert np.array_equal(volumes[:, column], found.T @ y[:, column])


def test_views_pixels_and_sums(operators):
    found, oracle = operators
    x = np.random.default_rng(4).random(found.shape[1])
    whole = found @ x
    assert np.array_equal(found.view(1) @ x, whole[480:960])
    assert np.array_equal(found.subset([2, 0]) @ x, np.r_[whole[960:], whole[:480]])
    some = np.arange(5, 1440, 7)
    assert np.array_equal(found.take(some) @ x, whole[some])
    np.testing.assert_allclose(found.row_sums, oracle.row_sums, atol=1e-11)
    np.testing.assert_allclose(found.column_sums, oracle.column_sums, rtol=1e-11)
    assert found.n_segments > 0


def test_active_voxels_alone_are_unknowns(scene, host):
    grid, rays, view_ptr = scene
    active = ActiveVoxels.from_mask(grid, np.random.default_rng(5).random(grid.shape) < 0.4)
    found = DeviceProjector(OnTheFlyProjector(rays, grid, view_ptr, active), host)
    oracle = Projector(trace(rays, grid, "reference", dtype=np.float64, active=active), grid,
                       view_ptr, active)  # fmt: skip
    random = np.random.default_rng(6)
    x, y = random.random((active.size, 5)), random.normal(size=(1440, 5))
    np.testing.assert_allclose(found @ x, oracle @ x, atol=1e-11)
    np.testing.assert_allclose(found.T @ y, oracle.T @ y, atol=1e-10)


def test_sums_reach_their_bound_without_overflow(host):
    """All rays pass the only voxel with the largest pixel, of either sign."""
    grid = VoxelGrid((1, 1, 1), 1.0)
    rays = Rays.from_lines(np.tile([[-3.0, 0.1, 0.2]], (5000, 1)), [1.0, 0, 0])
    found = DeviceProjector(OnTheFlyProjector(rays, grid), host)
    for value in (1.0, -1.0, 1e300, -1e-300, 5e-324):
        assert found.T @ np.full(5000, value) == pytest.approx([5000 * value], rel=1e-15)
    assert (found.T @ np.zeros(5000)).tolist() == [0.0]


def test_rays_of_negative_weight_cancel(host):
    """Quadratures have some; sums of lengths then bound nothing."""
    grid = VoxelGrid((3, 1, 1), 1.0)
    single = Rays.from_lines(np.tile([[-9.0, 0.1, 0.2]], (40, 1)), [1.0, 0, 0])
    weight = np.tile([3.0, -2.0], 20)
    rays = Rays(single.origins, single.directions, single.lengths, weight, np.arange(0, 41, 2))
    found = DeviceProjector(OnTheFlyProjector(rays, grid), host)
    np.testing.assert_allclose(found @ np.ones(3), 3 * np.ones(20), rtol=1e-14)
    np.testing.assert_allclose(found.T @ np.ones(20), 20 * np.ones(3), rtol=1e-14)
    alone = Rays(single.origins, single.directions, single.lengths, weight, np.arange(41))
    found = DeviceProjector(OnTheFlyProjector(alone, grid), host)
    np.testing.assert_allclose(found.T @ np.sign(weight), 100 * np.ones(3), rtol=1e-14)


def test_what_is_not_finite_reaches_what_it_meets(operators):
    found, oracle = operators
    y, pixel = np.ones(found.shape[0]), int(oracle.row_sums.argmax())
    y[pixel] = np.nan
    met = oracle.T @ np.eye(found.shape[0])[pixel] > 0
    assert np.array_equal(np.isnan(found.T @ y), met)
    y[pixel] = -np.inf
    both = found.T @ np.stack([y, np.ones(1440)], axis=1)
    assert np.array_equal(np.isneginf(both[:, 0]), met)
    assert np.array_equal(both[:, 1], found.T @ np.ones(1440))
    x = np.ones(found.shape[1])
    voxel = np.flatnonzero(met)[3]
    x[voxel] = np.nan
    sees = oracle @ np.eye(found.shape[1])[voxel] > 0
    assert np.array_equal(np.isnan(found @ x), sees)


def test_an_operator_without_pixels(scene, host):
    grid, rays, _ = scene
    found = DeviceProjector(OnTheFlyProjector(rays.take(np.arange(0)), grid), host)
    assert (found @ np.ones(grid.size)).shape == (0,)
    assert not (found.T @ np.ones(0)).any()


@pytest.mark.parametrize("form", ["all", "some"])
@pytest.mark.parametrize("cut", [False, True])
def test_gas_that_absorbs(scene, host, form, cut):
    from rigs.scene.gas import ExtinctionVolume

    grid, rays, view_ptr = scene
    random = np.random.default_rng(7)
    around = ExtinctionVolume(
        0.05 * random.random((4, 5, 3)), grid.lower - [4, 2, 3], (5.0, 4.0, 6.0)
    )
    active = ActiveVoxels(grid) if form == "all" else ActiveVoxels.from_mask(
        grid, random.random(grid.shape) < 0.5
    )  # fmt: skip
    if cut:  # a path of two pieces, one behind the other inside the grid
        ends = np.repeat(rays.lengths, 2)
        ends[::2] = 120.0
        origins = np.repeat(rays.origins, 2, axis=0)
        origins[1::2] += 120.0 * rays.directions
        ptr = np.arange(0, 2 * len(rays) + 1, 2)
        rays = Rays(origins, np.repeat(rays.directions, 2, axis=0), ends,
                    np.repeat(rays.weight, 2), 2 * rays.pixel_ptr, ptr)  # fmt: skip
    flying = OnTheFlyProjector(rays, grid, view_ptr, active)
    emission = random.random(active.size)
    for gas in (Absorption(0.03), Absorption(emission=0.1), Absorption(0.02, 0.05, around)):
        exact = AttenuatedProjector(flying, gas, emission)
        found = DeviceProjector(flying, host).with_absorption(gas, emission)
        x, y = random.random(active.size), random.normal(size=1440)
        np.testing.assert_allclose(found @ x, exact @ x, rtol=3e-6, atol=1e-6)
        scale = np.abs(exact.T @ y).max()
        assert np.abs(found.T @ y - exact.T @ y).max() < 3e-6 * scale
        assert dot_test(found, 1, np.float64) < 1e-12
        assert np.array_equal(found.take(np.arange(9, 99)) @ x, (found @ x)[9:99])
        clear = found.without_absorption
        assert np.abs(clear @ x - flying @ x).max() < 1e-9 * np.abs(flying @ x).max()


def test_the_exponential_is_exact_to_its_last_digits(host):
    grid = VoxelGrid((1, 1, 1), 1.0)
    flying = OnTheFlyProjector(Rays.from_lines([[-3.0, 0.1, 0.2]], [1.0, 0, 0]), grid)
    device = DeviceProjector(flying, host)
    for depth in (1e-20, 1e-9, 0.1, 0.3465, 0.3466, 1.0, 12.3, 345.6, 699.0):
        found = device.with_absorption(Absorption(2 * depth)) @ np.ones(1)
        assert found == pytest.approx(np.exp([-depth]), rel=4e-16 * max(1.0, depth / 100))
    assert (device.with_absorption(Absorption(1e5)) @ np.ones(1)).tolist() == [0.0]


@pytest.mark.parametrize("dtype", [np.float32, np.float64])
def test_stored_entries(lines, host, shuffled, dtype):
    found, other = DeviceMatrix(lines, host), DeviceMatrix(lines, shuffled)
    exact = lines.to_scipy().astype(np.float64)
    random = np.random.default_rng(8)
    x = random.random((lines.shape[1], 6)).astype(dtype)
    y = random.normal(size=(lines.shape[0], 6)).astype(dtype)
    bound = 1e-6 if dtype == np.float32 else 1e-13
    for product, right in ((found @ x, exact @ x), (found.T @ y, exact.T @ y)):
        assert product.dtype == dtype
        assert np.linalg.norm(product - right) < bound * np.linalg.norm(right)
    assert np.array_equal(found @ x, other @ x)
    assert np.array_equal(found.T @ y, other.T @ y)
    for column in range(6):
        assert np.array_equal((found @ x)[:, column], found @ x[:, column])
        assert np.array_equal((found.T @ y)[:, column], found.T @ y[:, column])
    some = np.arange(3, 400, 9)
    assert np.array_equal(found.take(some) @ x, (found @ x)[some])
    assert dot_test(found.subset([3, 0]), 1, dtype) < (1e-6 if dtype == np.float32 else 1e-12)
    assert found.view(1).shape[0] == 0
    assert found.n_segments == lines.n_segments
    np.testing.assert_allclose(found.column_sums, lines.column_sums, rtol=1e-6)


def test_other_libraries_arrays_come_back_as_theirs(operators, lines, host):
    torch = pytest.importorskip("torch")
    for operator in (operators[0], DeviceMatrix(lines, host)):
        x = np.random.default_rng(9).random(operator.shape[1], np.float32)
        images = operator @ torch.from_numpy(x)
        assert isinstance(images, torch.Tensor)
        assert np.array_equal(images.numpy(), operator @ x)
        volume = operator.T @ images
        assert isinstance(volume, torch.Tensor)
        assert np.array_equal(volume.numpy(), operator.T @ images.numpy())
        two = operator @ torch.from_numpy(np.stack([x, x], axis=1))
        assert two.shape == (operator.shape[0], 2)
        with pytest.raises(ValueError, match=r"found int64 \(3,\), expected float32 or float64"):
            operator @ torch.arange(3)


def test_a_lens_that_bends_needs_no_table_of_its_own(host):
    grid = VoxelGrid((8, 8, 8), 1.0)
    rig = rigs.ring(2, distance=60.0, image_size=(16, 16), footprint=1.2)
    bent = [
        replace(camera, distortion=rigs.Distortion("brown", (-0.2, 0.05, 0.001, 0.002, 0.0)))
        for camera in rig
    ]
    flying = OnTheFlyProjector(list(map(pixel_source, bent)), grid)
    x = np.random.default_rng(0).random(grid.size)
    found = DeviceProjector(flying, host) @ x
    assert np.abs(found - flying @ x).max() < 1e-4 * found.max()  # its table is float32
