"""Images as files and folders: those of a rig, missing ones, and ones that do not fit."""

import shutil

import numpy as np

from rigs import save_rig
from rigs.recordings import write_image
from tomo import load_scan, scan_of_images


def test_a_rig_and_a_folder_of_images(folder, tmp_path, rig, frames, assert_refused):
    rig_file = tmp_path / "rig.yaml"
    save_rig(rig, rig_file)
    for given in (rig, rig_file):
        scan = scan_of_images(given, folder / "images")
        assert scan.frame_names == ("first", "second")
        np.testing.assert_array_equal(scan.images("second")[1], frames["second"]["right"])
    write_image(folder / "images/left/first.png", np.zeros((5, 7), np.uint8))
    assert_refused(lambda: scan_of_images(rig, folder / "images"), "camera left", "'first' twice")
    shutil.rmtree(folder / "images/left")
    assert_refused(
        lambda: scan_of_images(rig, folder / "images"),
        "camera left",
        "no folder left",
        error=FileNotFoundError,
    )


def test_the_real_plume(test_data):
    scan = load_scan(test_data / "scalarflow" / "transforms.json")
    assert "frame_090" in scan.frame_names
    small = scan.without("cam02").scaled(6)
    images = small.images("frame_090")
    assert len(images) == 4
    assert all(image.shape == (320, 180) and 0 < image.max() <= 1 for image in images)


def test_missing_images_and_cameras(folder, frames, edit, assert_refused):
    (folder / "images/right/first.tif").unlink()
    assert_refused(
        lambda: load_scan(folder).images(),
        "camera right",
        "first.tif: no such image",
        error=FileNotFoundError,
    )
    edit(folder, lambda content: content["frames"][0]["images"].pop("right"))
    scan = load_scan(folder)
    assert_refused(scan.images, "scan.yaml", "frame 'first'", "camera right", "no image")
    np.testing.assert_array_equal(scan.without("right").images()[0], frames["first"]["left"])
    edit(folder, lambda content: content["frames"][0]["images"].update(cam9="images/x.tif"))
    assert_refused(lambda: load_scan(folder), "scan.yaml", "frame 'first'", "'cam9'", "left")


def test_folders_that_fit_no_camera_are_listed(folder, tmp_path, rig, assert_refused):
    images = tmp_path / "misspelt"
    shutil.copytree(folder / "images", images)
    (images / "left").rename(images / "lefft")
    assert_refused(
        lambda: scan_of_images(rig, images),
        "camera left: found no folder left",
        "it has lefft, right",
        error=FileNotFoundError,
    )
    (images / "lefft").rename(images / "left")
    for image in (images / "left").iterdir():
        image.rename(image.with_suffix(".raw"))
    assert_refused(
        lambda: scan_of_images(rig, images), f"{images / 'left'}: camera left", ".tif, .tiff, .png"
    )


def test_bad_pixels(folder, assert_refused):
    path = folder / "images/left/first.tif"

    def refused(image, *parts):
        write_image(path, image)
        assert_refused(load_scan(folder).images, "camera left", "first.tif", *parts)

    refused(np.zeros((7, 5), np.float32), "5 x 7 pixels, expected 7 x 5")
    refused(np.full((5, 7), np.nan), "35 NaN", "row 0, column 0")
    import tifffile

    tifffile.imwrite(path, np.indices((5, 7, 3))[2].astype(np.uint8))
    assert_refused(load_scan(folder).images, "camera left", "first.tif", "3 channels")
    path.write_bytes(path.read_bytes()[:60])
    assert_refused(load_scan(folder).images, "camera left", "first.tif", "not a readable image")
