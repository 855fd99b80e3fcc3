"""Volumes and images as xarray holds them: they come back as they were."""

import numpy as np
import pytest

import rigs
import tomo
from rigs import Rig, ring
from tomo.grid import VoxelGrid
from tomo.io import data_array, volume_of_data_array

xarray = pytest.importorskip("xarray")
GRID = VoxelGrid((3, 4, 5), (0.1, 0.3, 0.7), (0.3, -1 / 3, 700.0))
VOLUME = np.random.default_rng(0).random(GRID.shape, np.float32)
ARRAY = data_array(VOLUME, GRID, "mm", "counts per mm")
RIG = ring(3, distance=50, image_size=(12, 14), footprint=0.3)
BARE = ARRAY.drop_attrs()


def test_a_volume_comes_back_bit_for_bit():
    data = volume_of_data_array(ARRAY)
    assert data.tobytes() == VOLUME.tobytes()
    assert (data.grid, data.length_unit, data.value_unit) == (GRID, "mm", "counts per mm")


def test_a_volume_comes_back_from_a_file(tmp_path):
    pytest.importorskip("h5netcdf")
    ARRAY.to_netcdf(tmp_path / "volume.nc", engine="h5netcdf")
    with xarray.open_dataarray(tmp_path / "volume.nc", engine="h5netcdf") as array:
        assert VoxelGrid.from_xarray(array) == GRID
        np.testing.assert_array_equal(volume_of_data_array(array), VOLUME)


def test_dimensions_may_stand_in_any_order_and_coordinates_may_descend():
    turned = ARRAY.transpose("z", "x", "y").isel(x=slice(None, None, -1), z=slice(None, None, -1))
    data = volume_of_data_array(turned)
    np.testing.assert_array_equal(data, VOLUME)
    assert data.grid == GRID


@pytest.mark.parametrize("array", [ARRAY, BARE], ids=["noted", "bare"])
@pytest.mark.parametrize(
    "part",
    [
        {},
        {"x": slice(1, None)},
        {"y": slice(0, 3), "z": slice(0, None, 2)},
        {"x": slice(0, 2), "y": slice(1, 3)},
    ],
    ids=str,
)
def test_the_grid_of_a_part_has_its_coordinates(array, part):
    chosen = array.isel(part)
    grid = VoxelGrid.from_xarray(chosen)
    assert grid.shape == chosen.shape
    for axis, name in zip(grid.axes(), "xyz", strict=True):
        np.testing.assert_allclose(axis, chosen[name].values, rtol=1e-12)


def test_coordinates_in_single_precision_are_even():
    rough = BARE.assign_coords(z=BARE.z.values.astype(np.float32))
    assert VoxelGrid.from_xarray(rough).spacing[2] == pytest.approx(0.7, rel=1e-4)


@pytest.mark.parametrize(
    ("array", "words"),
    [
        (BARE.isel(x=[0]), "coordinates: x: found 0.2 alone, expected two or more"),
        (BARE.isel(z=[0, 1, 3]), "coordinates: z: found steps from 0.7 to 1.4, expected even"),
        (BARE.assign_coords(y=[0, 1, np.nan, 3]), "coordinates: y: found steps"),
        (BARE.assign_coords(y=[1.0, 1.0, 1.0, 1.0]), "coordinates: y: found steps"),
        (BARE.assign_coords(y=list("abcd")), "coordinates: y: found <U1, expected some numbers"),
        (BARE.drop_vars("y"), "coordinates: y: found none"),
        (BARE.isel(y=0), "volume: found the dimensions x, z, expected x, y and z"),
        (BARE.expand_dims(time=2), r"choose one by array.isel\(time=0\)"),
        (
            BARE.assign_coords(x=BARE.x.assign_attrs(units="m")),
            "coordinates: units: found m, mm, expected one",
        ),
    ],
)
def test_wrong_coordinates_are_refused_in_one_line(array, words):
    with pytest.raises(ValueError, match=words) as caught:
        volume_of_data_array(array)
    assert "\n" not in str(caught.value)


def test_an_array_is_an_emission_on_its_own_grid():
    grid = VoxelGrid((4, 5, 4), 0.4)
    volume = np.random.default_rng(1).random(grid.shape, np.float32)
    scan = tomo.simulate(RIG, data_array(volume, grid))
    assert scan.grid == grid
    np.testing.assert_allclose(scan.truth, volume, rtol=1e-6)
    with pytest.raises(ValueError, match="field: length unit: found 'm', expected 'mm'"):
        tomo.simulate(RIG, data_array(volume, grid, "m"))


def test_images_come_back():
    images = {name: np.random.default_rng(k).random((14, 12), np.float32)
              for k, name in enumerate(RIG.names)}  # fmt: skip
    mask = np.ones((14, 12))
    mask[3, 4] = 0
    scan = tomo.Scan.from_arrays(RIG, images, masks={"cam01": mask})
    array = scan.to_xarray()
    assert array.dims == ("camera", "row", "column")
    assert np.isnan(array.sel(camera="cam01", row=3, column=4))
    again = tomo.Scan.from_arrays(RIG, array.fillna(0.0).transpose("row", "camera", "column"))
    for name, image in zip(RIG.names, again.images(), strict=True):
        expected = images[name] * mask if name == "cam01" else images[name]
        np.testing.assert_array_equal(image, expected.astype(np.float32))
    both = array.fillna(0.0).to_dataset("camera")
    np.testing.assert_array_equal(tomo.Scan.from_arrays(RIG, both).images()[0], images["cam00"])
    with pytest.raises(ValueError, match="images: found the dimensions row, column, expected"):
        tomo.Scan.from_arrays(RIG, array.isel(camera=0, drop=True))


def test_cameras_of_several_sizes_are_refused():
    rig = Rig((RIG["cam00"], RIG["cam01"].scaled(0.5)))
    scan = tomo.Scan.from_arrays(rig, {"cam00": np.ones((14, 12)), "cam01": np.ones((7, 6))})
    with pytest.raises(ValueError, match="found sizes 6 x 7, 12 x 14, expected one"):
        scan.to_xarray()


def test_a_missing_library_is_one_line(monkeypatch):
    monkeypatch.setitem(__import__("sys").modules, "xarray", None)
    with pytest.raises(ValueError, match=r"install it by pip install 'flametomo\[notebook\]'"):
        data_array(VOLUME, GRID)


def test_without_a_grid_the_rig_s_own_is_simulated():
    volume = rigs.Volume((4, 5, 4), 0.4)
    rig = Rig(RIG.cameras, volume=volume)
    scan = tomo.simulate(rig, lambda points: np.ones(len(points)))
    assert scan.grid == VoxelGrid((4, 5, 4), 0.4)
    with pytest.raises(ValueError, match="grid: found none, expected a VoxelGrid"):
        tomo.simulate(RIG, lambda points: np.ones(len(points)))
