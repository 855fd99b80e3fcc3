"""Corrections by folder, by a pattern and by a call: the same images as by a scan.yaml."""

import numpy as np
import pytest

from rigs.recordings import write_image
from tomo import load_scan, scan_of_images
from tomo.scan import Corrections

DARK = {"left": 0.25, "right": 0.5}


@pytest.fixture
def darks(folder, rig):
    """Write two dark frames a camera, whose mean is `DARK`, and a mask of the left one."""
    for camera in rig:
        shape = camera.image_size[::-1]
        for name, change in (("a", -0.125), ("b", 0.125)):
            level = np.full(shape, DARK[camera.name] + change, np.float32)
            write_image(folder / "dark" / camera.name / f"{name}.tif", level)
        write_image(folder / "one" / f"{camera.name}.tif", np.full(shape, DARK[camera.name]))
    mask = np.ones(rig["left"].image_size[::-1], np.uint8)
    mask[0, 0] = 0
    write_image(folder / "masks" / "left.png", mask)
    return folder


@pytest.mark.parametrize("given", ["dark", "one", "one/{camera}.tif", "dark/{camera}", DARK])
def test_a_dark_is_the_same_however_it_is_given(darks, rig, frames, edit, given):
    edit(darks, lambda content: content.update(corrections={"dark": given}))
    here = given if isinstance(given, dict) else str(darks / given)
    scans = [
        load_scan(darks),
        scan_of_images(rig, darks / "images").with_corrections(dark=here),
        scan_of_images(rig, darks / "images", corrections=Corrections(dark=here)),
    ]
    for scan in scans:
        for name, image in zip(rig.names, scan.images("second"), strict=True):
            expected = frames["second"][name] - DARK[name]
            np.testing.assert_allclose(image, expected, rtol=1e-6, atol=1e-7)


def test_a_mean_follows_the_bits_of_the_images(folder, rig):
    for number in (90, 110):
        for camera in rig:
            counts = np.full(camera.image_size[::-1], number, np.uint16)
            write_image(folder / "dark" / camera.name / f"{number}.tif", counts)
    scan = scan_of_images(rig, folder / "images").with_corrections(dark=folder / "dark")
    for bits, full in ((None, 65535), (12, 4095)):
        level = scan.with_corrections(bit_depth=bits).corrections.pixels("dark", "left", (7, 5))
        np.testing.assert_allclose(level, 100 / full, rtol=1e-6)


def test_a_folder_without_a_camera_is_refused_but_for_masks(darks, rig, edit, assert_refused):
    scan = scan_of_images(rig, darks / "images")
    masked = scan.with_corrections(mask=str(darks / "masks"))
    left, right = masked.masks()
    assert np.argwhere(~left).tolist() == [[0, 0]]
    assert right.all()
    for path in (darks / "dark" / "right").iterdir():
        path.unlink()
    assert_refused(
        lambda: scan.with_corrections(dark=str(darks / "dark")),
        f"{darks / 'images'}: corrections.dark: camera right: found no image of it in",
    )
    edit(darks, lambda content: content.update(corrections={"dark": "dark/{camera}"}))
    assert_refused(lambda: load_scan(darks), "scan.yaml: corrections.dark: camera right: found no")
    assert_refused(
        lambda: scan.with_corrections(mask=str(darks / "one")).scaled(2).with_corrections(gain=2),
        "scale: found 2, expected 1 before corrections",
    )
    assert_refused(lambda: scan.with_corrections(dark={"top": 0.1}), "camera 'top', expected one")
    assert_refused(
        lambda: scan.with_corrections(flat=-1), "corrections.flat: found -1, expected a"
    )


def test_images_by_a_pattern_in_scan_yaml(folder, rig, frames, edit, assert_refused):
    def change(content):
        del content["frames"]
        content["images"] = "images/{camera}/{frame}.tif"

    edit(folder, change)
    scan = load_scan(folder)
    assert scan.frame_names == ("first", "second")
    for name, image in zip(rig.names, scan.images("second"), strict=True):
        np.testing.assert_array_equal(image, frames["second"][name])
    edit(folder, lambda content: content.update(images="{camera}.tif"))
    assert_refused(
        lambda: load_scan(folder), "scan.yaml: images: ", "camera left", "'{camera}.tif'"
    )
    edit(folder, lambda content: content.update(images="../{camera}.tif"))
    assert_refused(lambda: load_scan(folder), "scan.yaml: images: found '../{camera}.tif'")
    edit(folder, lambda content: content.update(frames=[]))
    assert_refused(lambda: load_scan(folder), "scan.yaml: ")


def test_a_link_in_a_folder_does_not_leave_the_scan(darks, edit, assert_refused, tmp_path):
    write_image(tmp_path / "elsewhere.tif", np.ones((5, 7), np.float32))
    (darks / "dark" / "left" / "c.tif").symlink_to(tmp_path / "elsewhere.tif")
    edit(darks, lambda content: content.update(corrections={"dark": "dark"}))
    assert_refused(lambda: load_scan(darks), "corrections.dark: found", "inside the scan folder")
