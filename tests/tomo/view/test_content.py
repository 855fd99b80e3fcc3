import json
from dataclasses import replace

import numpy as np
import pytest

from tomo.io import write_volume
from tomo.view import (
    Content,
    content_of_film,
    content_of_outcome,
    content_of_rig,
    content_of_volume,
)
from tomo.view.content import Frames, Model
from tomo.view.page import compare


@pytest.fixture(scope="module")
def folder(scan, tmp_path_factory):
    return scan.save(tmp_path_factory.mktemp("scan") / "scan").parent


def outcome(folder, grid, volume, **scan):
    """Write what is needed of an output folder."""
    folder.mkdir(exist_ok=True)
    write_volume(folder / "volume.npz", volume, grid, "mm", value_unit="full scales per mm")
    report = {"scan": scan, "views": {"cam00": {"relative_residual": 0.125}}}
    report["basis"] = {"name": "voxel"}
    (folder / "report.json").write_text(json.dumps(report))
    return folder


def test_frames_are_read_when_shown_and_few_are_kept(flames):
    read = []

    def reader(place):
        read.append(place)
        return np.where(flames[place] > 0.9, np.nan, flames[place])

    frames = Frames(("a", "b", "c"), reader, most_bytes=2 * flames[0].nbytes)
    assert read == []
    for place in (0, 1, 0, 1, 2, 1, 0):
        volume = frames.volume(place)
        assert np.isfinite(volume).all()
        assert volume.max() <= 0.9
    assert read == [0, 1, 2, 0]
    assert frames.spread() == [2, 1, 0]
    assert Frames("x" * 30, reader).spread() == [29, 22, 14, 7, 0]


def test_the_volume_s_own_image_leaves_no_residual(content, flames, grid):
    found = compare(content, "cam02", 1)
    assert found.relative_residual < 1e-5
    half = Frames(("half",) * 3, lambda place: flames[place] / 2)
    doubled = replace(content, frames=half, model=Model(False, {"cam02": 2.0}, {"cam02": 0.25}))
    view = compare(doubled, "cam02", 1)
    np.testing.assert_allclose(view.measured - view.reprojected, -0.25, atol=1e-4)
    linear = compare(replace(content, model=Model(True)), "cam02", 1)
    assert 1e-4 < linear.relative_residual < 0.1
    alone = compare(replace(content, frames=None), "cam02", 1)
    np.testing.assert_array_equal(alone.measured, found.measured)
    beside = replace(content, grid=replace(grid, center=(1e3, 0, 0)))
    for dark in (alone, compare(beside, "cam02", 1)):
        assert dark.relative_residual == pytest.approx(1)


def test_an_outcome_finds_its_scan_where_it_was_and_beside_it(tmp_path, folder, grid, flames):
    frame = {"frame": "frame_001", "scale": 1}
    out = outcome(tmp_path / "out", grid, flames[1], source=str(folder / "scan.yaml"), **frame)
    content = content_of_outcome(out)
    assert content.moments == ("frame_001",)
    assert content.notes == ()
    assert content.residual("cam00", 0) == 0.125
    assert content.residual("cam01", 0) is None
    assert content.value_unit == "full scales per mm"
    (tmp_path / "out" / "moved").symlink_to(folder)
    moved = outcome(tmp_path / "out", grid, flames[1], source="/nowhere/moved", **frame)
    assert content_of_outcome(moved).scan is not None


@pytest.mark.parametrize("source", [None, "/nowhere/scan.yaml"])
def test_an_outcome_without_its_scan_shows_the_volume_and_says_what_to_do(
    tmp_path, folder, grid, flames, source
):
    from tomo import load_scan

    out = outcome(tmp_path, grid, flames[1], source=source, frame="frame_001", scale=2)
    content = content_of_outcome(out)
    assert content.rig is None
    assert content.scan is None
    assert "--scan SCAN" in content.notes[0]
    found = content_of_outcome(out, load_scan(folder))
    assert found.rig[0].image_size == (12, 14)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"frame": "other"}, "frame: found 'other', expected one of frame_000"),
        ({"frame": "frame_001", "channel": "purple"}, "channel"),
    ],
)
def test_a_scan_that_is_not_the_outcome_s_is_refused(
    tmp_path, folder, grid, flames, change, message
):
    out = outcome(tmp_path, grid, flames[1], source=str(folder), **change)
    with pytest.raises(ValueError, match=message):
        content_of_outcome(out)


def test_a_damaged_report_is_named(tmp_path, grid, flames):
    out = outcome(tmp_path, grid, flames[0])
    for text in ("{", "[]"):
        (out / "report.json").write_text(text)
        with pytest.raises(ValueError, match=r"report\.json"):
            content_of_outcome(out)


def test_a_store_shows_its_complete_frames_by_their_numbers(film_store, volumes):
    content = content_of_film(film_store.path)
    assert len(content.frames) == len(volumes) - 1
    assert content.names[4] == "frame 55, 0.05 s"  # frame 54 could not be read
    np.testing.assert_array_equal(content.frames.volume(4), volumes[5])
    assert content.residual("right", 4) == 0.2
    assert content.residual("other", 4) is None
    assert any("1 of 20 frames" in note for note in content.notes)
    assert content.rig is None  # this store was made without one


def test_a_film_of_volumes_is_shown_too(tmp_path, grid, flames):
    from tomo.io import VolumeFilm

    film = VolumeFilm.create(tmp_path / "truth.zarr", grid, range(3))
    for number, volume in enumerate(flames):
        film.write(number, volume)
    content = content_of_film(tmp_path / "truth.zarr")
    np.testing.assert_array_equal(content.frames.volume(2), flames[2])


def test_rigs_and_volumes_stand_alone(tmp_path, scan, grid, flames):
    content = content_of_rig("rig", scan.rig)
    assert content.n_frames == 0
    assert content.scan is None
    seen = content_of_rig("scan", scan.rig, None, scan)
    assert seen.n_frames == 3
    assert seen.scan.rig.names == scan.rig.names
    write_volume(tmp_path / "v.npz", flames[0], grid, "mm")
    assert content_of_volume(tmp_path / "v.npz").grid == grid
    with pytest.raises(ValueError, match="neither a rig nor a volume"):
        Content("nothing")
