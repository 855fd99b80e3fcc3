"""Paths in a scan file: none leads out of its folder."""

import os

import numpy as np
import pytest

from rigs.recordings import write_image
from tomo import load_scan


@pytest.mark.parametrize(
    "escape", ["/etc/passwd", "../other/first.tif", "images/../../x.tif", "C:\\x.tif", "..\\x.tif"]
)
def test_paths_that_leave_the_folder(folder, escape, edit, assert_refused):
    def change_image(content):
        content["frames"][0]["images"]["left"] = escape

    def change_truth(content):
        content["truth"] = escape

    def change_dark(content):
        content["corrections"] = {"dark": {"left": escape}}

    def change_rig(content):
        content["rig"] = escape

    original = (folder / "scan.yaml").read_text()
    for change, field in [
        (change_image, "frame 'first': camera left"),
        (change_truth, "truth"),
        (change_dark, "corrections.dark: camera left"),
        (change_rig, "rig"),
    ]:
        (folder / "scan.yaml").write_text(original)
        edit(folder, change)
        assert_refused(lambda: load_scan(folder), "scan.yaml", field, "inside the scan folder")


def test_links_that_leave_the_folder(folder, tmp_path, assert_refused):
    outside = tmp_path / "outside.tif"
    write_image(outside, np.zeros((5, 7)))
    link = folder / "images/left/first.tif"
    link.unlink()
    os.symlink(outside, link)
    assert_refused(lambda: load_scan(folder), "camera left", "inside the scan folder")
    moved = tmp_path / "linked"  # the folder itself may be reached through a link
    link.unlink()
    write_image(link, np.zeros((5, 7)))
    os.symlink(folder, moved)
    assert load_scan(moved).images()[0].shape == (5, 7)


@pytest.mark.parametrize("inside", ["images\\left\\first.tif", "images/../images/left/first.tif"])
def test_paths_of_any_system_that_stay_in_the_folder(folder, inside, edit):
    before = load_scan(folder).images()

    def change(content):
        content["frames"][0]["images"]["left"] = inside

    edit(folder, change)
    np.testing.assert_array_equal(load_scan(folder).images()[0], before[0])
