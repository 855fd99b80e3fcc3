"""Lines on what files say of their images and readers do not heed."""

import cv2
import numpy as np
import pytest
import tifffile
from PIL import Image

from rigs.recordings import image_notes, image_size, read_still

GREY = np.random.default_rng(0).integers(0, 255, (7, 9), dtype=np.uint8)


def write(path, orientation):
    """Write a file whose tag or EXIF says an orientation."""
    if path.suffix == ".tif":
        tag = [(274, "H", 1, orientation, True)]
        tifffile.imwrite(path, GREY, photometric="minisblack", extratags=tag)
        return
    exif = Image.Exif()
    exif[274] = orientation
    Image.fromarray(GREY).save(path, exif=exif, quality=100)


@pytest.mark.parametrize("suffix", [".tif", ".png", ".jpg", ".webp"])
@pytest.mark.parametrize("orientation", [1, 3, 4, 6])
def test_pixels_are_as_stored_and_a_note_says_what_the_file_asks_for(
    tmp_path, suffix, orientation
):
    path, plain = tmp_path / f"a{suffix}", tmp_path / f"plain{suffix}"
    write(path, orientation)
    write(plain, 1)
    np.testing.assert_array_equal(read_still(path).pixels, read_still(plain).pixels)
    assert image_size(path) == (9, 7)
    asked = [note for note in image_notes({"cam": [path]}) if "orientation tag" in note]
    assert len(asked) == (orientation != 1)
    for note in asked:
        assert note.startswith(f"camera cam: an orientation tag ({orientation}) asks for images")
        assert "used as stored" in note


def test_equal_notes_are_one_line_that_names_cameras_and_counts(tmp_path):
    for name, orientation in (("a", 4), ("b", 1), ("c", 4)):
        write(tmp_path / f"{name}.tif", orientation)
    a, b, c = (tmp_path / f"{name}.tif" for name in "abc")
    (note,) = image_notes({"left": [a, b], "mid": [b], "right": [c]})
    assert note.startswith("cameras left, right (2 of 3 images): an orientation tag (4)")
    (note,) = image_notes({f"cam{k}": [a] for k in range(12)})
    assert note.startswith(
        "cameras cam0, cam1, cam2, cam3, cam4 and 7 more: an orientation tag (4)"
    )


@pytest.mark.parametrize(
    ("suffix", "is_lossy"), [(".jpg", True), (".png", False), (".tif", False)]
)
def test_one_note_on_gamma_and_8_bits(tmp_path, suffix, is_lossy):
    for name in "ab":
        cv2.imwrite(str(tmp_path / f"{name}{suffix}"), GREY)
    notes = image_notes({"cam": [tmp_path / f"a{suffix}"], "cam2": [tmp_path / f"b{suffix}"]})
    assert len(notes) == is_lossy
    assert all("8 bits" in note and "gamma" in note for note in notes)


def test_what_cannot_be_read_is_left_to_the_reader_of_pixels(tmp_path):
    (tmp_path / "a.tif").write_bytes(b"II*\0")
    (tmp_path / "b.jpg").write_bytes(b"\xff\xd8\xff")
    paths = [tmp_path / "a.tif", tmp_path / "b.jpg", tmp_path / "absent.tif"]
    assert image_notes({"cam": paths}) == []
