"""What is saved and loaded again, whole or not at all."""

import errno
from pathlib import Path

import numpy as np
import pytest

from rigs.recordings import write_image
from tomo import load_scan
from tomo.io import read_volume
from tomo.scan import save_scan


def test_round_trip(folder, rig, frames, grid):
    for path in (folder, folder / "scan.yaml", str(folder)):
        scan = load_scan(path)
        assert scan.rig == rig
        assert scan.grid == grid
        assert scan.frame_names == ("first", "second")
        for name, images in frames.items():
            for found, expected in zip(scan.images(name), images.values(), strict=True):
                assert found.dtype == np.float32
                np.testing.assert_array_equal(found, expected)
            assert all(mask.dtype == bool and mask.all() for mask in scan.masks(name))
    assert read_volume(scan.truth)[1] == grid
    assert scan.effects is None


def test_what_a_scan_was_simulated_with_comes_back(tmp_path, rig, frames):
    camera = rig.names[0]
    effects = {"absorption": 0.5, "focus_distance": None, "gains": {camera: 1.25}}
    save_scan(tmp_path, rig, frames, effects=effects)
    found = load_scan(tmp_path).effects
    assert found["absorption"] == 0.5
    assert found["vignetting"] == 0
    assert found["focus_distance"] is None
    assert found["gains"] == {camera: 1.25}


def test_an_interrupted_run_leaves_the_scan_that_was_there(tmp_path, monkeypatch, rig, frames):
    save_scan(tmp_path, rig, frames)
    before = {path: path.read_bytes() for path in tmp_path.rglob("*") if path.is_file()}
    brighter = {
        frame: {camera: 2 * image for camera, image in images.items()}
        for frame, images in frames.items()
    }
    calls = []

    def full_disk(path, image):
        calls.append(path)
        if len(calls) == 2:
            raise OSError(errno.ENOSPC, "No space left on device", str(path))
        write_image(path, image)

    monkeypatch.setattr("tomo.scan.write.write_image", full_disk)
    with pytest.raises(OSError, match="No space left") as caught:
        save_scan(tmp_path, rig, brighter)
    assert Path(caught.value.filename).parents[2] == tmp_path  # as the user knows it
    assert {path: path.read_bytes() for path in tmp_path.rglob("*") if path.is_file()} == before
    assert load_scan(tmp_path)


@pytest.mark.parametrize("name", ["../x", "a/b", ".hidden", "", "a:b"])
def test_names_that_are_no_file_names(tmp_path, name, rig, frames, assert_refused):
    assert_refused(lambda: save_scan(tmp_path / "s", rig, {name: frames["first"]}), repr(name))
    assert not (tmp_path / "s").exists()


def test_saving_what_does_not_fit(tmp_path, rig, frames, assert_refused):
    wrong = {"left": np.zeros((7, 5), np.float32)}
    assert_refused(lambda: save_scan(tmp_path / "s", rig, {"f": wrong}), "camera left", "(7, 5)")
    truth = np.zeros((2, 2, 2))
    assert_refused(lambda: save_scan(tmp_path / "s", rig, frames, truth=truth), "truth", "grid")
    assert not (tmp_path / "s").exists()
