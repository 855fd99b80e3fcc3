from xml.etree import ElementTree

import h5py
import numpy as np
import pytest
import xarray
import zarr

from tomo.export import FORMATS, export_series
from tomo.io import read_volume
from tomo.series import SeriesStore

SOME = (2, 5, 11)


@pytest.fixture
def exported(store, tmp_path):
    """Return a function: a format to the file of some frames."""

    def write(to, places=SOME):
        suffix = FORMATS[to].suffixes[0]
        return export_series(store, tmp_path / f"flame{suffix}", to, places)

    return write


def test_a_pvd_names_a_file_and_a_time_for_every_frame(store, exported):
    written = exported("pvd")
    root = ElementTree.parse(written).getroot()
    assert root.get("type") == "Collection"
    entries = root.findall("./Collection/DataSet")
    assert [float(one.get("timestep")) for one in entries] == [place / 100 for place in SOME]
    for entry, place in zip(entries, SOME, strict=True):
        data, grid, unit = read_volume(written.parent / entry.get("file"))
        assert np.array_equal(data, store.volume(place))
        np.testing.assert_allclose(grid.origin, store.grid.origin)
        assert unit == "mm"


def test_npz_files_are_named_by_the_numbers_of_frames(store, exported):
    files = sorted(exported("npz").iterdir())
    assert [one.name for one in files] == [f"frame_{50 + place:06d}.npz" for place in SOME]
    assert np.array_equal(read_volume(files[1])[0], store.volume(5))


def test_an_ome_zarr_has_axes_units_and_the_place_of_its_voxels(store, exported):
    even = (1, 3, 5)
    group = zarr.open_group(exported("ome-zarr", even), mode="r", zarr_format=3)
    about = group.attrs["ome"]
    assert about["version"] == "0.5"
    (image,) = about["multiscales"]
    assert image["axes"] == [
        {"name": "t", "type": "time", "unit": "second"},
        *({"name": name, "type": "space", "unit": "millimeter"} for name in "zyx"),
    ]
    (level,) = image["datasets"]
    scale, shift = level["coordinateTransformations"]
    np.testing.assert_allclose(scale["scale"], [0.02, *store.grid.spacing[::-1]])
    np.testing.assert_allclose(shift["translation"], [0.01, *store.grid.origin[::-1]])
    data = group[level["path"]]
    assert data.metadata.dimension_names == ("t", "z", "y", "x")
    for number, place in enumerate(even):
        np.testing.assert_array_equal(data[number].T, store.volume(place))
    with pytest.raises(FileExistsError, match="is there already"):
        exported("ome-zarr", even)


def test_an_ome_zarr_of_uneven_times_is_refused(exported):
    with pytest.raises(ValueError, match=r"time: found frames 52 and 55 0\.03 apart, .* for OME"):
        exported("ome-zarr", SOME)


def test_a_vtkhdf_is_laid_out_as_published(store, exported):
    with h5py.File(exported("vtkhdf")) as file:
        root = file["VTKHDF"]
        assert root.attrs["Type"] == b"ImageData"
        assert root.attrs["Version"].tolist()[0] == 2
        nx, ny, nz = store.grid.shape
        assert root.attrs["WholeExtent"].tolist() == [0, nx - 1, 0, ny - 1, 0, nz - 1]
        np.testing.assert_allclose(root.attrs["Origin"], store.grid.origin)
        np.testing.assert_allclose(root.attrs["Spacing"], store.grid.spacing)
        assert root["Steps"].attrs["NSteps"] == len(SOME)
        np.testing.assert_allclose(root["Steps/Values"], [place / 100 for place in SOME])
        data = root["PointData/emission"]
        assert data.chunks == (1, nz, ny, nx)
        for offset, place in zip(root["Steps/PointDataOffsets/emission"], SOME, strict=True):
            assert np.array_equal(data[offset].T, store.volume(place))


def test_xarray_reads_a_netcdf_with_units_and_figures(store, exported):
    with xarray.open_dataset(exported("netcdf"), engine="h5netcdf") as data:
        assert data.emission.dims == ("time", "x", "y", "z")
        assert data.emission.attrs["units"] == "counts per mm"
        for name in "xyz":
            np.testing.assert_allclose(data[name], store.group[name][:])
            assert data[name].attrs["units"] == "mm"
        np.testing.assert_allclose(data.time, [place / 100 for place in SOME])
        assert data.frame.values.tolist() == [50 + place for place in SOME]
        assert data.camera.values.astype(str).tolist() == ["left", "right"]
        np.testing.assert_allclose(data.psnr[:, 1], 31.0)
        assert data.attrs["Conventions"] == "CF-1.11"
        for at, place in enumerate(SOME):
            assert np.array_equal(data.emission[at], store.volume(place))


def test_frames_that_could_not_be_read_are_left_out(store, exported):
    with xarray.open_dataset(exported("netcdf", None), engine="h5netcdf") as data:
        assert 54 not in data.frame.values
        assert len(data.frame) == store.n_frames - 1


def test_frames_that_are_not_complete_are_named(store, attributes, tmp_path):
    empty = SeriesStore.create(tmp_path / "out.zarr", store.grid, [0, 1], [0, 1], attributes)
    with pytest.raises(ValueError, match="2 that are not complete, the first is 0"):
        export_series(empty, tmp_path / "a.pvd", "pvd")


@pytest.mark.parametrize(
    ("to", "target", "part"),
    [
        ("stl", "a.stl", "to: found 'stl', expected one of pvd"),
        *((to, "a.xml", "suffix: found '.xml'") for to in FORMATS if to != "npz"),
    ],
)
def test_other_formats_and_suffixes_are_refused(store, tmp_path, to, target, part):
    with pytest.raises(ValueError, match=part):
        export_series(store, tmp_path / target, to, [0])


def test_a_missing_library_is_named_with_what_to_type(store, tmp_path, monkeypatch):
    monkeypatch.setattr("tomo.export.export.find_spec", lambda name: None)
    with pytest.raises(ValueError, match=r"needs the library av: .*flametomo\[export\]"):
        export_series(store, tmp_path / "a.mp4", "mp4")


def test_no_more_than_a_few_volumes_are_in_memory(filled, tmp_path, exported, monkeypatch):
    """Every format asks for frames one by one, and keeps none."""
    import weakref

    shape, alive, most = (4, 5, 6), [], []
    long = filled(tmp_path / "long.zarr", [np.ones(shape, np.float32)] * 5)

    first = long.volume(0)

    def volume(place):
        array = first.like(np.full(shape, place, np.float32))
        alive.append(weakref.ref(array))
        most.append(sum(one() is not None for one in alive))
        return array

    for to, chosen in FORMATS.items():
        monkeypatch.setattr(long, "volume", volume)
        export_series(long, tmp_path / f"{to}{chosen.suffixes[0]}", to)
    assert max(most) <= 3
