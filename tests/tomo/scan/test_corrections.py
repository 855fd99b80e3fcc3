"""Dark frame, flat field, gain, mask and saturation: what they make of the pixels."""

from pathlib import Path

import numpy as np
import pytest

from rigs.recordings import write_image
from tomo import Scan, load_scan
from tomo.scan import Corrections, Frame


def test_corrections_follow_the_formula(folder, frames, edit):
    random = np.random.default_rng(5)
    dark = random.random((5, 7)).astype(np.float32) * 0.1
    flat = 0.5 + random.random((5, 7)).astype(np.float32)
    write_image(folder / "dark.tif", dark)
    write_image(folder / "flat.tif", flat)
    corrections = {
        "dark": {"left": "dark.tif", "right": 0.25},
        "flat": {"left": "flat.tif"},
        "gain": {"right": 3.0},
    }
    edit(folder, lambda content: content.update(corrections=corrections))
    left, right = load_scan(folder).images("first")
    raw = frames["first"]
    np.testing.assert_allclose(left, (raw["left"] - dark) / flat, rtol=1e-5, atol=1e-7)
    np.testing.assert_allclose(right, (raw["right"] - 0.25) * 3, rtol=1e-5, atol=1e-6)


def test_masks_come_from_mask_saturation_and_dead_flat(folder, edit):
    mask = np.full((5, 7), 255, np.uint8)
    mask[0, 0] = 0
    flat = np.ones((5, 7), np.float32)
    flat[1, 1] = 0
    write_image(folder / "mask.png", mask)
    write_image(folder / "flat.tif", flat)
    raw = np.full((5, 7), 0.5, np.float32)
    raw[0, 0], raw[2, 3] = np.nan, 1.0
    write_image(folder / "images/left/first.tif", raw)
    corrections = {
        "mask": {"left": "mask.png"},
        "flat": {"left": "flat.tif"},
        "saturation": 0.99,
        "bit_depth": 12,
    }
    edit(folder, lambda content: content.update(corrections=corrections))
    scan = load_scan(folder).only("left")
    (image,), (usable,) = scan.read("first")
    assert np.argwhere(~usable).tolist() == [[0, 0], [1, 1], [2, 3]]
    assert np.isfinite(image).all()
    np.testing.assert_array_equal(image[usable], 0.5)
    np.testing.assert_array_equal(image[~usable], 0)


@pytest.mark.parametrize("name", ["saturation", "dark"])
def test_counts_of_a_camera_are_no_correction_of_integers(folder, name, edit, assert_refused):
    """Integers are read as shares of full scale: no pixel would be saturated, or none dark."""
    edit(folder, lambda content: content.update(corrections={name: {"left": 400}}))
    load_scan(folder).images("first")
    write_image(folder / "images/left/first.tif", np.full((5, 7), 4095, np.uint16))
    assert_refused(
        load_scan(folder).images,
        f"scan.yaml: corrections.{name}: camera left: found 400",
        "expected at most 1, the full scale of integers like those in",
        "first.tif",
    )


@pytest.mark.parametrize(
    ("kind", "bits", "full"),
    [
        (np.uint16, 12, 4095),
        (np.uint16, None, 65535),
        (np.uint8, None, 255),
        (np.float32, None, 1),
    ],
)
def test_integers_at_full_scale_are_left_out(rig, kind, bits, full):
    """The light of a saturated pixel is not known; floating point has no full scale."""
    width, height = rig["left"].image_size
    image = np.full((height, width), 0.9 * full).astype(kind)
    image[2, 3:5] = full
    corrections = Corrections(bit_depth=bits, dark=0.01)
    scan = Scan.from_arrays(rig[:1], {"left": image}, corrections=corrections)
    (shown,), (usable,), saturated, *_ = scan.read_with_faults()
    expected = [[2, 3], [2, 4]] if kind is not np.float32 else []
    assert np.argwhere(~usable).tolist() == expected
    assert saturated["left"] == pytest.approx(len(expected) / (height * width))
    np.testing.assert_array_equal(shown[~usable], 0)


def test_corrections_of_a_scan_built_by_hand(tmp_path, rig, frames):
    """A scan is a value: no file but its images is needed."""
    write_image(tmp_path / "a.tif", frames["first"]["left"])
    frame = Frame("only", {"left": tmp_path / "a.tif"})
    scan = Scan(rig[:1], (frame,), Corrections(gain={"left": 2.0}))
    np.testing.assert_allclose(scan.images()[0], 2 * frames["first"]["left"], rtol=1e-6)


def test_text_names_the_image_of_a_correction():
    found = Corrections(dark={"cam00": "dark.tif"}, flat="flat.tif", mask=None)
    assert found.of("dark", "cam00") == Path("dark.tif")
    assert found.of("flat", "cam07") == Path("flat.tif")
