import copy
import pickle

import numba
import numpy as np
import pytest
import torch
import xarray

import rigs
from tomo import LinearSystem, Volume, VoxelGrid, mean_and_rms

# Different counts, edges and offsets along every axis: no mix-up of axes can pass.
GRID = VoxelGrid((9, 14, 7), (0.5, 0.4, 0.6), (0.3, -0.2, 0.1))
UNIT = "counts per mm"


@pytest.fixture
def volume():
    return Volume(np.random.default_rng(0).random(GRID.shape, np.float32), GRID, "mm", UNIT)


def ball(grid, radius=1.5, width=0.25):
    distance = np.linalg.norm(grid.centers() - grid.center, axis=-1)
    return Volume(1 / (1 + np.exp((distance - radius) / width)), grid)


def test_it_is_an_array_to_whoever_takes_one(volume, tmp_path):
    assert isinstance(volume, np.ndarray)
    bare = np.asarray(volume)
    assert type(bare) is np.ndarray
    assert np.shares_memory(bare, volume)
    assert np.shares_memory(torch.from_numpy(volume).numpy(), volume)
    np.testing.assert_array_equal(volume, bare)
    np.testing.assert_allclose(volume, volume.astype(np.float64))
    assert volume.std() == bare.std()
    assert volume.sum() == bare.sum()
    assert type(volume.max()) is np.float32
    np.save(tmp_path / "a.npy", volume)
    loaded = np.load(tmp_path / "a.npy")
    assert loaded.dtype == np.float32
    np.testing.assert_array_equal(loaded, bare)
    array = xarray.DataArray(volume, dims=("x", "y", "z"))
    np.testing.assert_array_equal(array.isel(x=2).values, bare[2])
    double = numba.njit(lambda values: 2 * values)
    np.testing.assert_array_equal(double(volume), 2 * bare)


@pytest.mark.parametrize(
    "kept",
    [
        copy.copy,
        copy.deepcopy,
        lambda volume: pickle.loads(pickle.dumps(volume)),
        lambda volume: pickle.loads(pickle.dumps(volume, protocol=2)),
        lambda volume: volume.astype(np.float32),
        lambda volume: volume[...],
        lambda volume: volume[:, :],
        lambda volume: np.clip(volume, 0, 1),
        lambda volume: volume + 0 * volume,
        lambda volume: np.round(volume, 9),
    ],
)
def test_copies_and_the_whole_keep_grid_and_units(volume, kept):
    found = kept(volume)
    assert type(found) is Volume
    assert found.grid == GRID
    assert found.length_unit == "mm"
    np.testing.assert_allclose(found, volume, rtol=1e-6)


@pytest.mark.parametrize(
    "part",
    [
        lambda volume: volume[1:],
        lambda volume: volume[::-1],
        lambda volume: volume[0],
        lambda volume: volume[volume > 0.5],
        lambda volume: volume.T,
        lambda volume: volume.transpose(2, 1, 0),
        lambda volume: volume.ravel(),
        lambda volume: volume.sum(axis=0),
        lambda volume: volume.mean(axis=1, keepdims=True),
        lambda volume: np.cumsum(volume, axis=0),
        lambda volume: np.flip(volume, 0),
        lambda volume: np.concatenate([volume, volume]),
        lambda volume: np.gradient(volume)[0],
        lambda volume: np.add.outer(volume, [1, 2]),
        lambda volume: volume[None] * np.ones((2, 1, 1, 1)),
        lambda volume: next(iter(volume)),
    ],
)
def test_what_lies_on_no_grid_is_a_plain_array(volume, part):
    found, expected = part(volume), part(np.asarray(volume))
    assert type(found) is np.ndarray
    np.testing.assert_array_equal(found, expected)


def test_a_cube_that_is_turned_keeps_no_grid():
    cube = Volume(np.arange(27.0).reshape(3, 3, 3), VoxelGrid((3, 3, 3), 1.0))
    for turned in (cube.T, np.swapaxes(cube, 0, 1), cube[::-1], cube.reshape(3, 3, 3)):
        assert type(turned) is np.ndarray


def test_arithmetic_is_on_one_grid_and_knows_units(volume):
    assert (volume + volume).value_unit == (volume - 1).value_unit == UNIT
    assert (volume * volume).value_unit == (2 * volume).value_unit == ""
    assert (volume + volume.like(volume, "counts per m")).value_unit == ""
    assert type(volume > 0.5) is Volume
    before = volume.copy()
    same = volume
    same += 1
    same[0] = 3
    assert same is volume
    np.testing.assert_array_equal(volume[1:], before[1:] + 1)
    other = VoxelGrid(GRID.shape, GRID.spacing, (0.3, -0.2, 0.2))
    with pytest.raises(ValueError, match=r"volumes: found VoxelGrid.* one grid: resample"):
        volume - Volume(volume, other)
    with pytest.raises(ValueError, match="expected one grid"):
        volume += Volume(volume, other)
    # origins of files are rounded
    rounded = VoxelGrid.from_origin(GRID.shape, GRID.spacing, np.float32(GRID.origin))
    assert rounded != GRID
    assert (volume - Volume(before, rounded)).grid == GRID


def test_bad_values_are_refused(volume):
    with pytest.raises(ValueError, match=r"volume: found shape \(8, 14, 7\), expected the grid"):
        Volume(volume[1:], GRID)
    with pytest.raises(ValueError, match="expected real numbers"):
        Volume(volume.astype(complex), GRID)
    with pytest.raises(AttributeError, match="found no grid"):
        np.asarray(volume).view(Volume).grid  # noqa: B018


def test_samples_are_linear_between_centres_and_zero_beyond(volume):
    np.testing.assert_allclose(volume.sample(GRID.centers()), volume, rtol=1e-6)
    x, y, z = np.moveaxis(GRID.centers(), -1, 0)
    linear = Volume(1 + x + 2 * y - 3 * z, GRID)
    points = np.random.default_rng(1).uniform(GRID.origin, -GRID.origin / 2, (50, 3))
    np.testing.assert_allclose(linear.sample(points), 1 + points @ [1, 2, -3], rtol=1e-9)
    assert volume.sample(GRID.upper + GRID.spacing) == 0
    face = GRID.origin - (GRID.spacing[0] / 2, 0, 0)
    assert volume.sample(face) == pytest.approx(volume[0, 0, 0] / 2, rel=1e-6)
    with pytest.raises(ValueError, match=r"points: found shape \(2,\)"):
        volume.sample([0, 1])
    distance, values = linear.profile((0, 0, 0), (1, 0, 1))
    assert distance[[0, -1]] == pytest.approx([0, np.sqrt(2)])
    np.testing.assert_allclose(values, 1 - np.sqrt(2) * distance, atol=1e-9)
    assert len(linear.profile((0, 0, 0), (1, 0, 0), 7)[0]) == 7


def test_the_image_is_that_of_the_operator_and_dark_where_nothing_is_seen(volume):
    rig = rigs.ring(3, distance=100, image_size=(30, 40), footprint=0.3, pitch_degrees=10)
    system = LinearSystem.from_rig(rig, GRID)
    images = system.images(system.projector @ volume.ravel())
    np.testing.assert_allclose(volume.project(rig["cam01"]), images[1], atol=1e-5)
    finer = LinearSystem.from_rig(rig, GRID, supersample=3)
    expected = finer.images(finer.projector @ volume.ravel())[2]
    np.testing.assert_allclose(volume.project(rig["cam02"], supersample=3), expected, atol=1e-5)
    away = Volume(volume, VoxelGrid(GRID.shape, GRID.spacing, (0, 500, 0)))
    assert not away.project(rig["cam00"]).any()


def test_surfaces_have_the_area_of_a_sphere_and_end_at_the_box():
    grid = VoxelGrid((30, 36, 26), (0.15, 0.12, 0.17), (3, -7, 11))
    sphere = 4 * np.pi * 1.5**2
    volume = ball(grid)
    assert volume.area(0.5) == pytest.approx(sphere, rel=0.01)
    mesh = volume.isosurface(0.5)
    assert mesh.is_watertight
    assert mesh.volume == pytest.approx(np.pi * 1.5**3 * 4 / 3, rel=0.02)
    np.testing.assert_allclose(mesh.centroid, grid.center, atol=1e-3)
    half = volume.crop(grid.lower, (3, 99, 99))  # the cut is no part of the front
    # it ends at the last centres, 0.075 before the middle
    assert half.area(0.5) == pytest.approx(sphere / 2 - 2 * np.pi * 1.5 * 0.075, rel=0.01)
    assert half.isosurface(0.5).area > 1.4 * half.area(0.5)
    with pytest.raises(ValueError, match="level: found 0"):
        volume.area(0)


def test_totals_and_parts(volume):
    assert volume.total() == pytest.approx(float(volume.sum(dtype=float)) * 0.5 * 0.4 * 0.6)
    holed = volume.copy()
    holed[2, 3, 4] = np.nan
    less = float(volume[2, 3, 4]) * 0.12
    assert holed.total() == pytest.approx(volume.total() - less, rel=1e-6)
    part = volume.crop((-1, -1, -1), (1, 1, 1))
    assert np.shares_memory(part, volume)
    np.testing.assert_allclose(part.sample(part.grid.centers()), part, rtol=1e-6)
    np.testing.assert_allclose(volume.sample(part.grid.centers()), part, rtol=1e-6)
    assert (np.abs(part.grid.centers()) <= 1).all()
    with pytest.raises(ValueError, match="crop: found no voxel"):
        volume.crop((9, 9, 9), (10, 10, 10))


def test_resampling_keeps_the_same_means_coarser_and_is_linear_finer(volume):
    np.testing.assert_allclose(volume.resample(GRID), volume, rtol=1e-6)
    fine = volume.resample(GRID.refined(3))
    assert fine.dtype == np.float32
    np.testing.assert_allclose(fine, volume.sample(fine.grid.centers()), atol=1e-6)
    np.testing.assert_allclose(fine.resample(GRID), GRID.average(np.asarray(fine), 3), atol=1e-6)
    around = VoxelGrid((5, 6, 7), 1.7, (0.2, 0, 0))  # odd edges, beyond the box
    assert volume.resample(around).total() == pytest.approx(volume.total(), rel=1e-6)
    holed = volume.copy()
    holed[0, 0, 0] = np.nan
    moved = VoxelGrid(GRID.shape, GRID.spacing, np.add(GRID.center, 0.1))
    assert np.isnan(holed.resample(moved)).sum() == 1


def test_xarray_gets_coordinates_and_units(volume):
    array = volume.to_xarray()
    assert VoxelGrid.from_xarray(array) == GRID
    assert array.attrs["units"] == UNIT
    assert array.x.attrs["units"] == "mm"


def test_mean_and_rms_are_volumes_of_volumes(volume):
    mean, rms = mean_and_rms(volume + k for k in (0, 1, 2))
    assert mean.value_unit == rms.value_unit == UNIT
    np.testing.assert_allclose(mean, volume + 1, rtol=1e-6)
    np.testing.assert_allclose(rms, np.sqrt(2 / 3), rtol=1e-6)
    with pytest.raises(ValueError, match="found none"):
        mean_and_rms([])
    other = Volume(volume, VoxelGrid(GRID.shape, 1.0))
    with pytest.raises(ValueError, match="expected one grid"):
        mean_and_rms([volume, other])


def test_it_says_what_it_is(volume):
    assert repr(volume) == f"<Volume: float32 on {GRID!r} mm, {UNIT}>"
    assert "unit unknown" in repr(volume * volume)
    assert str(volume) == str(np.asarray(volume))
