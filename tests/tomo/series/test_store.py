from contextlib import nullcontext

import numpy as np
import pytest
import xarray
import zarr

from tomo.series import SeriesStore
from tomo.series.solving import SKIPPED


def test_xarray_reads_the_store_with_units_and_coordinates(film, undisturbed, recwarn):
    with xarray.open_zarr(undisturbed.path, consolidated=False) as data:
        assert data.emission.dims == ("time", "x", "y", "z")
        for axis, name in enumerate("xyz"):
            places = film.grid.origin[axis] + film.grid.spacing[axis] * np.arange(
                film.grid.shape[axis]
            )
            np.testing.assert_allclose(data[name], places)
            assert data[name].attrs["units"] == film.rig.length_unit
        assert data.emission.attrs["units"] == f"image units per {film.rig.length_unit}"
        np.testing.assert_array_equal(data.emission[3], undisturbed.volume(3))
        assert data.psnr.dims == ("time", "camera")
        assert data.attrs["options"]["hold_out"] == list(film.options.hold_out)
        assert data.attrs["rig"]["cameras"][0]["name"] == film.rig.names[0]
        assert data.attrs["versions"]["flametomo"]
    assert not [one for one in recwarn if "Zarr" in str(one.category)]


def test_a_frame_is_one_chunk(film, undisturbed):
    assert undisturbed.group["emission"].chunks == (1, *film.grid.shape)
    files = [p for p in (undisturbed.path / "emission" / "c").rglob("*") if p.is_file()]
    assert len(files) == len(film.truths)


def test_the_plan_says_what_was_settled_and_from_which_frames(undisturbed):
    plan = undisturbed.attributes["plan"]
    assert plan["key_frames"] == ["frame_002", "frame_008"]
    assert plan["choice"] in plan["choices"]
    assert set(plan["noise"]) == {"cam00", "cam01", "cam03", "cam04"}


def test_figures_that_are_not_numbers_have_files_too(undisturbed, tmp_path, monkeypatch):
    """Another thread that opens a store may take a common setting of zarr back at any moment."""
    monkeypatch.setattr(zarr.config, "set", lambda *_: nullcontext())
    about = undisturbed.attributes
    made = SeriesStore.create(tmp_path / "out.zarr", undisturbed.grid, [0, 1], [0, 1], about)
    made.finish(range(2), [SKIPPED, SKIPPED])
    assert (made.path / "nrmse" / "c" / "0").is_file()


def test_incomplete_frames_are_not_handed_out(undisturbed, tmp_path):
    store = SeriesStore.create(
        tmp_path / "out.zarr", undisturbed.grid, [0, 1], [0, 1], undisturbed.attributes
    )
    assert not store.complete.any()
    with pytest.raises(ValueError, match="frame 1: found it missing"):
        store.volume(1)


@pytest.mark.parametrize(
    ("change", "part"),
    [({"format": "other"}, "format: found 'other'"), ({"version": 2}, "version: found 2")],
)
def test_stores_of_other_kinds_are_refused(tmp_path, change, part):
    zarr.create_group(
        tmp_path / "a.zarr", attributes={"format": "emission-series", "version": 1} | change
    )
    with pytest.raises(ValueError, match=part):
        SeriesStore(tmp_path / "a.zarr")


@pytest.mark.parametrize("inside", [(), ("emission",)])
def test_a_store_that_lacks_an_array_is_refused(tmp_path, inside):
    store = zarr.create_group(
        tmp_path / "a.zarr", attributes={"format": "emission-series", "version": 1}
    )
    for name in inside:  # a group where the array should be
        store.create_group(name)
    with pytest.raises(ValueError, match="emission: found no such array"):
        SeriesStore(tmp_path / "a.zarr")


def test_psnr_and_ssim_say_their_peak_with_its_unit(undisturbed):
    peak = undisturbed.attributes["plan"]["peak"]
    assert peak["value"] > 0
    assert (peak["unit"], peak["origin"]) == ("image units", "brightest measured pixel")
    for name in ("psnr", "ssim"):
        assert undisturbed.group[name].attrs["peak"] == peak
