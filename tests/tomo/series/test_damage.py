"""Stores with damaged files: what is said of them, and that the same run mends them."""

import json
import os
import shutil
from dataclasses import replace

import numpy as np
import pytest
import zarr
import zarr.storage._local as local_store

from tomo.export import export_series
from tomo.series import SeriesStore, make_plan, reconstruct_series
from tomo.series import run as series_run
from tomo.series.verdict import SeriesTable
from tomo.view.opening import content_of_film

EMISSION = "emission/c/{}/0/0/0"
DAMAGES = {
    "flipped": lambda data: data[:9] + bytes([data[9] ^ 16]) + data[10:],
    "cut": lambda data: data[:-7],
    "empty": lambda data: b"",
    "missing": None,
}


class StoppedError(Exception):
    """The run ended here."""


def damage(store, file, kind):
    """Damage a file of a store."""
    path = store / file
    if DAMAGES[kind] is None:
        path.unlink()
    else:
        path.write_bytes(DAMAGES[kind](path.read_bytes()))


def read_all(path):
    """Return everything of a store that readers use, but wall times."""
    store = SeriesStore(path)
    table = SeriesTable.of(store)
    volumes = [store.volume(place).tobytes() for place in range(store.n_frames)]
    figures = [values.tobytes() for name, values in table.columns.items() if name != "seconds"]
    about = store.grid, store.attributes, table.frames.tolist(), table.times.tolist()
    return volumes, figures, about


@pytest.fixture(scope="module")
def options(film):
    return replace(film.options, method="sirt", iterations=9)


@pytest.fixture(scope="module", autouse=True)
def planned(film, options):
    """Let runs share one plan: they take it from the same images."""
    plan = make_plan(film.scan, film.grid, options, tuple(range(len(film.truths))))
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(series_run, "make_plan", lambda scan, *others: replace(plan, scan=scan))
        yield


@pytest.fixture(scope="module")
def whole(film, options, tmp_path_factory):
    """Return the path of a store that nothing has damaged."""
    path = tmp_path_factory.mktemp("whole") / "out.zarr"
    return reconstruct_series(film.scan, path, options=options).path


@pytest.fixture
def copy(whole, tmp_path):
    """Return the path of a copy, to be damaged."""
    return shutil.copytree(whole, tmp_path / "out.zarr")


@pytest.fixture
def old(whole, tmp_path):
    """Return the path of a store as it was written before chunks had checksums."""
    made = zarr.open_group(whole, mode="r")
    attributes = {name: value for name, value in made.attrs.items() if name != "checksum"}
    group = zarr.create_group(tmp_path / "old.zarr", zarr_format=3, attributes=attributes)
    for name, array in made.arrays():
        about = {
            "dimension_names": array.metadata.dimension_names,
            "attributes": dict(array.attrs),
        }
        fill = array.metadata.fill_value
        group.create_array(name, data=array[:], chunks=array.chunks, fill_value=fill, **about)
    return tmp_path / "old.zarr"


@pytest.mark.parametrize(
    ("file", "frames", "kind"),
    [
        *((EMISSION.format(3), "frame 3", kind) for kind in DAMAGES),
        ("view_gain/c/1/0", "frames 8 to 10", "flipped"),
        ("view_gain/c/1/0", "frames 8 to 10", "missing"),
        ("time/c/0", "all frames", "cut"),
    ],
)
def test_a_damaged_chunk_is_one_line_that_names_file_and_frames(
    copy, tmp_path, file, frames, kind
):
    damage(copy, file, kind)
    with pytest.raises(ValueError, match="damaged") as caught:
        read_all(copy)
    assert str(caught.value).startswith(f"{copy / file}: {frames}: ")
    with pytest.raises(ValueError, match="damaged") as caught:
        export_series(SeriesStore(copy), tmp_path / "volumes.nc", "netcdf")
    assert str(copy / file) in str(caught.value)
    assert "\n" not in str(caught.value)
    assert not (tmp_path / "volumes.nc").exists()


def test_a_frame_whose_volume_is_gone_is_not_complete(copy):
    damage(copy, EMISSION.format(3), "missing")
    store = SeriesStore(copy)
    assert np.flatnonzero(~store.complete).tolist() == [3]
    assert not store.finished
    with pytest.raises(ValueError, match=r"c/3/0/0/0: frame 3: .* no such file"):
        content_of_film(copy)


def test_the_same_run_mends_what_is_damaged_to_the_same_bits(
    film, options, whole, copy, assert_same, caplog
):
    kinds = list(DAMAGES)
    files = [EMISSION.format(place) for place in (0, 3, 7)]
    files += ["x/c/0", "complete/c/1", "frame/c/0"]
    for number, file in enumerate(files):
        damage(copy, file, kinds[number % len(kinds)])
    reconstruct_series(film.scan, copy, options=options)
    assert_same(SeriesStore(copy), SeriesStore(whole))
    for file in files:
        assert f"{copy / file}: " in caplog.text
    caplog.clear()
    reconstruct_series(film.scan, copy, options=options)
    assert not caplog.text


def test_frames_beside_a_damaged_one_stay_when_the_run_cannot_do_it_again(
    film, options, copy, whole
):
    damage(copy, EMISSION.format(3), "flipped")
    images = {name: each.copy() for name, each in film.images.items()}
    for each in images.values():
        each[4, 3, 3] = np.nan
    scan = type(film.scan).from_arrays(film.rig, images, film.grid)
    with pytest.raises(ValueError, match="NaN"):
        reconstruct_series(scan, copy, options=options)
    found, expected = SeriesStore(copy), SeriesStore(whole)
    assert np.flatnonzero(~found.complete).tolist() == [3]
    assert np.array_equal(found.volume(4), expected.volume(4))


def test_old_stores_are_read_and_mended_with_a_note(
    film, options, whole, old, assert_same, caplog
):
    for _ in range(2):
        assert read_all(old) == read_all(whole)
    assert caplog.text.count("found no checksums") == 1
    damage(old, EMISSION.format(3), "cut")
    damage(old, EMISSION.format(5), "missing")
    with pytest.raises(ValueError, match=r"c/3/0/0/0: frame 3: found it damaged"):
        read_all(old)
    reconstruct_series(film.scan, old, options=options)
    assert_same(SeriesStore(old), SeriesStore(whole))


@pytest.mark.parametrize(
    ("name", "kind"), [("emission", "cut"), ("complete", "missing"), ("x", "empty")]
)
def test_the_same_run_writes_damaged_descriptions_of_arrays_again(
    film, options, copy, whole, assert_same, caplog, name, kind
):
    damage(copy, f"{name}/zarr.json", kind)
    with pytest.raises(ValueError, match=name):
        read_all(copy)
    reconstruct_series(film.scan, copy, options=options)
    assert f"{name}/zarr.json: damaged; written again" in caplog.text
    assert_same(SeriesStore(copy), SeriesStore(whole))
    assert (copy / name / "zarr.json").read_bytes() == (whole / name / "zarr.json").read_bytes()


def test_damaged_descriptions_are_written_again_from_whole_attributes_alone(film, options, copy):
    damage(copy, "emission/zarr.json", "cut")
    about = json.loads((copy / "zarr.json").read_text())
    about["attributes"]["grid"]["spacing"] = [9.0, 9.0, 9.0]
    (copy / "zarr.json").write_text(json.dumps(about))
    found = (copy / "emission/zarr.json").read_bytes()
    with pytest.raises(ValueError, match=r"emission.zarr\.json: not readable, the command"):
        reconstruct_series(film.scan, copy, options=options)
    assert (copy / "emission/zarr.json").read_bytes() == found


@pytest.mark.parametrize(
    ("name", "value", "words"),
    [
        ("cameras", [1, 2, 3, 4, 5], "cameras, scan.frames: found other values"),
        ("plan", None, "plan: found None, expected a dict"),
        ("grid", {"shape": [1, 2]}, "attributes"),
        ("scan", {"frames": ["a"]}, "scan.frames: found 1 names, expected 11"),
        ("length_unit", "m", "found another checksum"),
    ],
)
def test_attributes_of_another_kind_are_refused_in_one_line(copy, name, value, words):
    about = json.loads((copy / "zarr.json").read_text())
    about["attributes"][name] = value
    if words != "found another checksum":
        about["attributes"].pop("checksum")
    (copy / "zarr.json").write_text(json.dumps(about))
    with pytest.raises(ValueError, match=words) as caught:
        SeriesStore(copy)
    assert str(copy) in str(caught.value)
    assert "\n" not in str(caught.value)


@pytest.fixture
def flushed(monkeypatch):
    """Return the files and folders that were flushed, as the system numbers them."""
    fsync, known = os.fsync, set()

    def counted(handle):
        found = os.fstat(handle)
        known.add((found.st_ino, found.st_mtime_ns))
        fsync(handle)

    monkeypatch.setattr(os, "fsync", counted)
    return known


def unflushed(path, known):
    """Return the files in a folder that a loss of power may take."""
    for file in sorted(path.rglob("*")):
        found = file.stat()
        is_known = (found.st_ino, found.st_mtime_ns) in known
        if file.is_file() and file.name != "lock" and not is_known:
            yield file


def test_all_is_on_the_disk_before_it_is_recorded(film, options, tmp_path, flushed, monkeypatch):
    put, path, records = local_store._put, tmp_path / "out.zarr", []

    def checked(file, *arguments, **settings):
        if file.relative_to(path.parent).parts[1:2] == ("complete",) and file.name != "zarr.json":
            assert not list(unflushed(path, flushed))
            records.append(file.name)
        return put(file, *arguments, **settings)

    monkeypatch.setattr(local_store, "_put", checked)
    reconstruct_series(film.scan, path, options=options)
    assert records == ["0", "1"]
    assert not list(unflushed(path, flushed))


def test_a_run_goes_on_to_the_same_bits_after_losses_of_power(
    film, options, whole, tmp_path, flushed, monkeypatch, assert_same
):
    put, path, left = local_store._put, tmp_path / "out.zarr", [0]

    def counted(file, *arguments, **settings):
        if "zarr.json" not in file.name and path.name in file.parts:
            left[0] -= 1
            if left[0] < 0:
                raise StoppedError
        return put(file, *arguments, **settings)

    monkeypatch.setattr(local_store, "_put", counted)
    for left[0] in (17, 24):  # in the figures of the first block, and in the second
        with pytest.raises(StoppedError):
            reconstruct_series(film.scan, path, options=options)
        lost = list(unflushed(path, flushed))
        for number, file in enumerate(lost):
            file.write_bytes(file.read_bytes()[: 5 * (number % 3)])
        assert lost
    monkeypatch.setattr(local_store, "_put", put)
    reconstruct_series(film.scan, path, options=options)
    assert_same(SeriesStore(path), SeriesStore(whole))
