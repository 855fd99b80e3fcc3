"""One colour of a scan: channels of images in colour, pixels of a mosaic."""

import cv2
import numpy as np
import pytest

from rigs import Rig
from rigs.recordings import Mosaic, write_image
from tomo import Scan, VoxelGrid, load_scan, scan_of_images
from tomo.scan import Corrections

RANDOM = np.random.default_rng(0)


@pytest.fixture
def mosaic(folder, rig):
    """Make a scan folder of mosaics of 16 bits; return it and the images."""
    images = {}
    for camera in rig:
        width, height = camera.image_size
        images[camera.name] = RANDOM.integers(0, 60000, (height, width), dtype=np.uint16)
        write_image(folder / "images" / camera.name / "first.tif", images[camera.name])
    return folder, images


@pytest.mark.parametrize("channel", ["r", "g", "g2", "b"])
def test_a_mosaic_s_colour_has_images_and_rays_of_its_own(mosaic, rig, edit, channel):
    folder, images = mosaic
    edit(folder, lambda c: c.update(corrections={"bayer": "GRBG", "channel": channel}))
    own = Mosaic("GRBG", channel)
    asked = scan_of_images(rig, folder / "images").of_channel(channel, "GRBG")
    for scan in (load_scan(folder), asked):
        assert [c.image_size for c in scan.rig] == [(3, 2), (4, 4)]
        for camera, found in zip(rig, scan.images("first"), strict=True):
            expected = own.pixels(images[camera.name]) / 65535
            np.testing.assert_allclose(found, expected, rtol=1e-6)
            for one, other in zip(
                scan.rig[camera.name].rays(), own.camera(camera).rays(), strict=True
            ):
                np.testing.assert_array_equal(one, other)


def test_cameras_as_recorded_come_back_from_one_colour_shrunk(mosaic, rig):
    folder, _ = mosaic
    scan = scan_of_images(rig, folder / "images").of_channel("b", "GBRG").scaled(2)
    for camera in rig:
        back = scan.recorded_camera(scan.rig[camera.name])
        assert back.image_size == camera.image_size
        np.testing.assert_allclose(back.camera_matrix, camera.camera_matrix, atol=1e-9)
    parts = scan.only("left").without()
    assert parts.rig["left"].image_size == (1, 1)


def test_cameras_may_differ(mosaic, edit):
    folder, images = mosaic
    edit(folder, lambda c: c.update(corrections={
        "bayer": {"left": "RGGB"}, "channel": {"left": "b"}}))  # fmt: skip
    left, right = load_scan(folder).images("first")
    np.testing.assert_allclose(left, images["left"][1:4:2, 1:6:2] / 65535, rtol=1e-6)
    np.testing.assert_allclose(right, images["right"] / 65535, rtol=1e-6)


def test_corrections_are_of_the_whole_sensor(mosaic, edit, frames):
    folder, images = mosaic
    dark = RANDOM.random((5, 7)).astype(np.float32) * 0.1
    mask = np.ones((5, 7), np.uint8)
    mask[0, 1] = 0
    write_image(folder / "dark.tif", dark)
    write_image(folder / "mask.png", mask)
    edit(folder, lambda c: c.update(corrections={
        "bayer": "RGGB", "channel": "g", "gain": 2, "dark": {"left": "dark.tif"},
        "mask": {"left": "mask.png"}}))  # fmt: skip
    found, usable = (one[0] for one in load_scan(folder).read("first"))
    whole = 2 * (images["left"] / 65535 - dark)
    expected = whole[0:4:2, 1:6:2]
    assert usable.tolist() == [[False, True, True], [True, True, True]]
    np.testing.assert_allclose(found[usable], expected[usable], atol=1e-6)
    assert found[0, 0] == 0


def test_saturation_is_found_among_pixels_of_one_colour(rig):
    """Two green pixels of a column at full scale are a plateau, though red lies between them."""
    image = np.zeros((8, 9), np.uint8)
    image[0:3:2, 1] = 255
    one = Rig((rig["right"],))
    corrections = Corrections(bayer="RGGB", channel="g")
    scan = Scan.from_arrays(one, {"right": image}, corrections=corrections)
    assert (~scan.masks()[0]).nonzero()[0].tolist() == [0, 1]
    assert (~scan.masks()[0]).nonzero()[1].tolist() == [0, 0]


def test_a_channel_of_images_in_colour(folder, rig, edit, assert_refused):
    colours = {}
    for camera in rig:
        width, height = camera.image_size
        image = RANDOM.integers(0, 255, (height, width, 3), dtype=np.uint8)
        colours[camera.name] = image
        cv2.imwrite(str(folder / "images" / camera.name / "first.png"), image[:, :, ::-1])
        (folder / "images" / camera.name / "first.tif").unlink()
        write_image(folder / f"{camera.name}.png", np.full((height, width), 255, np.uint8))

    def change(content):
        for camera in colours:
            content["frames"][0]["images"][camera] = f"images/{camera}/first.png"

    edit(folder, change)
    assert_refused(load_scan(folder).images, "camera left", "channel='g', 'r' or 'b'")
    masks = {name: f"{name}.png" for name in colours}
    edit(folder, lambda c: c.update(corrections={"channel": "g", "mask": masks}))
    for name, found in zip(rig.names, load_scan(folder).images("first"), strict=True):
        np.testing.assert_allclose(found, colours[name][:, :, 1] / 255, rtol=1e-6)


def test_what_does_not_fit_is_refused(folder, rig, edit, assert_refused):
    scan = load_scan(folder)
    assert_refused(lambda: scan.scaled(2).of_channel("g"), "scale: found 2, expected 1 before")
    assert_refused(lambda: scan.of_channel("x"), "scan.yaml", "channel: found 'x'")
    assert_refused(lambda: scan.of_channel("g", "RGB"), "bayer: found 'RGB', expected one of RGGB")
    assert_refused(lambda: scan.of_channel(None, "RGGB"), "camera left: channel: found none")
    assert_refused(scan.of_channel("g").images, "camera left", "found a grey image, expected col")
    for wrong in ({"bayer": "XXXX", "channel": "g"}, {"bayer": 3, "channel": "g"},
                  {"bayer": "RGGB", "channel": "green"}):  # fmt: skip
        edit(folder, lambda c, wrong=wrong: c.update(corrections=wrong))
        assert_refused(lambda: load_scan(folder), "corrections.", "expected one of")
    edit(folder, lambda c: c.update(corrections={"bayer": "RGGB"}))
    assert_refused(
        lambda: load_scan(folder), "scan.yaml", "channel: found none, expected one of r, g"
    )
    edit(folder, lambda c: c.update(corrections={"bayer": "RGGB", "channel": "g"}))
    assert_refused(lambda: load_scan(folder).of_channel("r"), "corrections.channel: found g")
    assert_refused(
        lambda: Scan.from_arrays(
            rig, {c.name: np.zeros(c.image_size[::-1]) for c in rig},
            corrections=Corrections(channel="g"),
        ),
        "found grey arrays",
    )  # fmt: skip


def test_one_colour_in_memory_is_not_saved_as_a_whole(tmp_path, rig, assert_refused):
    images = {c.name: np.zeros(c.image_size[::-1], np.float32) for c in rig}
    corrections = Corrections(bayer="RGGB", channel="g")
    scan = Scan.from_arrays(rig, images, VoxelGrid((2, 3, 4), 0.5), corrections=corrections)
    assert_refused(lambda: scan.save(tmp_path / "out"), "found one colour of a mosaic")


def test_a_scan_of_one_colour_takes_further_corrections(mosaic, rig):
    folder, _ = mosaic
    scan = scan_of_images(rig, folder / "images").of_channel("g", "RGGB")
    brighter = scan.with_corrections(gain=2.0)
    assert [c.image_size for c in brighter.rig] == [c.image_size for c in scan.rig]
    for one, other in zip(brighter.images("first"), scan.images("first"), strict=True):
        np.testing.assert_array_equal(one, 2 * other)
