"""Frames that cannot be read: named, and left out where that was asked for."""

from dataclasses import replace

import numpy as np
import pytest
import tifffile

from rigs import save_rig
from tomo import scan_of_images
from tomo.series import SeriesStore, reconstruct_series
from tomo.series.frames import readable_keys
from tomo.series.verdict import SeriesTable
from tomo.series.watching import watch

BAD = {3: "cam01", 5: "cam00"}  # 5 is a key frame of eleven


@pytest.fixture(scope="module")
def folder(film, tmp_path_factory):
    """Return a scan of one file an image, of which some are no images."""
    folder = tmp_path_factory.mktemp("bad")
    save_rig(film.rig, folder / "rig.yaml")
    for name, images in film.images.items():
        (folder / "images" / name).mkdir(parents=True)
        for number, image in enumerate(images):
            path = folder / "images" / name / f"frame_{number:03d}.tif"
            tifffile.imwrite(path, image.astype(np.float32))
            if BAD.get(number) == name:
                path.write_bytes(path.read_bytes()[:300])
    return folder


@pytest.fixture
def scan(folder, film):
    return replace(scan_of_images(folder / "rig.yaml", folder / "images"), grid=film.grid)


@pytest.fixture(scope="module")
def options(film):
    return replace(
        film.options,
        key_frames=1,
        method="mlem",
        iterations=3,
        screen=False,
        refine_cameras="none",
    )


def test_a_bad_frame_ends_the_run_and_is_named_with_what_goes_on(scan, options, tmp_path):
    with pytest.raises(
        ValueError, match=r"frame frame_005: .*cam00.*frame_005\.tif.*skip_bad=True"
    ):
        reconstruct_series(scan, tmp_path / "out.zarr", options=options)


def test_bad_frames_are_left_out_once_and_for_all(scan, options, tmp_path):
    skipping = replace(options, skip_bad=True)
    assert readable_keys(scan, range(11), skipping) == (6,)
    store = reconstruct_series(scan, tmp_path / "out.zarr", options=skipping)
    assert np.flatnonzero(store.skipped).tolist() == sorted(BAD)
    assert store.finished
    assert np.isnan(store.group["emission"][3]).all()
    assert np.isnan(store.group["view_gain"][3]).all()
    assert np.isfinite(store.volume(4)).all()
    with pytest.raises(ValueError, match="frame 3: found it left out"):
        store.volume(3)
    table = SeriesTable.of(store)
    (found,) = watch(table.columns, table.frames, table.cameras)
    assert found.line == "2 frames could not be read and left out: 3, 5"
    before = store.group["complete"][:]
    again = reconstruct_series(scan, tmp_path / "out.zarr", options=skipping)
    assert np.array_equal(again.group["complete"][:], before)


def test_a_run_that_a_bad_frame_ended_goes_on_without_it(scan, options, tmp_path, monkeypatch):
    """The key frame is good here: the run ends at a frame in the middle."""
    options = replace(options, frames="0:5")
    with pytest.raises(ValueError, match="frame_003"):
        reconstruct_series(scan, tmp_path / "out.zarr", options=options)
    assert not SeriesStore(tmp_path / "out.zarr").complete.any()
    store = reconstruct_series(
        scan, tmp_path / "out.zarr", options=replace(options, skip_bad=True)
    )
    assert np.flatnonzero(store.skipped).tolist() == [3]
    assert store.complete.sum() == 4


def test_a_film_of_bad_frames_alone_is_refused(scan, options, tmp_path):
    only = replace(options, frames="3:4", skip_bad=True)
    with pytest.raises(ValueError, match="frame frame_003"):
        reconstruct_series(scan, tmp_path / "out.zarr", options=only)


def test_frames_without_an_image_are_left_out_too(scan, options, tmp_path):
    frames = list(scan.frames)
    images = {name: one for name, one in frames[2].images.items() if name != "cam01"}
    lacking = replace(scan, frames=(*frames[:2], replace(frames[2], images=images), frames[4]))
    with pytest.raises(ValueError, match=r"frame_002.*cam01: found no image.*skip_bad=True"):
        reconstruct_series(lacking, tmp_path / "out.zarr", options=options)
    store = reconstruct_series(
        lacking, tmp_path / "out.zarr", options=replace(options, skip_bad=True)
    )
    assert np.flatnonzero(store.skipped).tolist() == [2]
    assert store.complete.sum() == 3
