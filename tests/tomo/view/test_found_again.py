"""What a rig and a folder of images gave shows its cameras and images again."""

import shutil

import numpy as np
import pytest

import phantoms
import tomo
from rigs import ring, save_rig
from rigs.recordings import write_image
from tomo.view.opening import content_of_film, content_of_outcome

GRID = tomo.VoxelGrid((6, 8, 6), 1.0)


@pytest.fixture(scope="module")
def fast(as_given):
    return as_given | {"method": "sirt", "iterations": 3}


@pytest.fixture
def folder(tmp_path):
    """Return a folder of a rig, and images of two moments and a dark frame a camera."""
    rig = ring(5, distance=150.0, image_size=(16, 20), footprint=0.7)
    made = tomo.simulate(rig, phantoms.create("jet", 2, GRID.extent), GRID)
    save_rig(rig, tmp_path / "here" / "rig.yaml")
    for name, image in zip(rig.names, made.images(), strict=True):
        for frame in "12":
            write_image(tmp_path / "here" / "images" / f"{frame}+{name}.tif", image + 0.5)
        write_image(tmp_path / "here" / "dark" / f"{name}.tif", np.full_like(image, 0.5))
    return tmp_path / "here"


@pytest.fixture
def scan(folder, monkeypatch):
    monkeypatch.chdir(folder)
    scan = tomo.scan_of_images("rig.yaml", "images", "{frame}+{camera}.tif", grid=GRID)
    return scan.with_corrections(dark="dark")


def test_a_still_and_a_film_find_rig_images_and_dark_frames(
    scan, folder, fast, tmp_path, monkeypatch
):
    tomo.reconstruct(scan, **fast, frame="2").save(folder / "out", with_pictures=False)
    tomo.reconstruct_series(scan, folder / "film.zarr", frames=":", **fast)
    expected = scan.images("2")
    monkeypatch.chdir(tmp_path)
    still, film = content_of_outcome(folder / "out"), content_of_film(folder / "film.zarr")
    for content in (still, film):
        assert content.notes == ()
        assert content.rig.names == scan.rig.names
        for one, other in zip(content.scan.images("2"), expected, strict=True):
            np.testing.assert_array_equal(one, other)
    assert still.moments == ("2",)
    assert film.moments == ("1", "2")


def test_images_and_rig_are_found_beside_an_outcome_that_moved(scan, folder, fast, tmp_path):
    scan = tomo.scan_of_images("rig.yaml", "images", "{frame}+{camera}.tif", grid=GRID)
    tomo.reconstruct(scan, **fast).save(folder / "out", with_pictures=False)
    shutil.move(folder, tmp_path / "there")
    assert content_of_outcome(tmp_path / "there" / "out").scan is not None
