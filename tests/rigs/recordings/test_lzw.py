"""LZW in TIFF files: whole ones are read, and damaged ones are not read as black."""

import io

import cv2
import numpy as np
import pytest
import tifffile

from rigs.recordings import read_image

RANDOM = np.random.default_rng(0)
SHAPE = (190, 170)
PATTERNS = {
    "noise": RANDOM.integers(0, 255, SHAPE),
    "dark": np.zeros(SHAPE, int),
    "slope": np.add.outer(np.arange(190), np.arange(170)) // 2,
    "few levels": RANDOM.integers(0, 4, SHAPE),
    "spots": 255 * (RANDOM.random(SHAPE) < 0.01),
    "one pixel": np.full((1, 1), 7),
}


def packed(image, *settings):
    given = [cv2.IMWRITE_TIFF_COMPRESSION, 5, *settings]
    return cv2.imencode(".tif", image, given)[1].tobytes()


@pytest.mark.parametrize("name", PATTERNS)
@pytest.mark.parametrize("dtype", [np.uint8, np.uint16])
@pytest.mark.parametrize(
    "settings",
    [(), (cv2.IMWRITE_TIFF_ROWSPERSTRIP, 7), (cv2.IMWRITE_TIFF_PREDICTOR, 2)],
    ids=["plain", "strips", "differences"],
)
def test_whole_images_are_read(tmp_path, name, dtype, settings):
    image = PATTERNS[name].astype(dtype)
    (tmp_path / "a.tif").write_bytes(packed(image, *settings))
    full = np.iinfo(dtype).max
    np.testing.assert_allclose(read_image(tmp_path / "a.tif"), image / full, atol=1e-7)


@pytest.mark.parametrize("kept", [0.1, 0.5, 0.9, 0.99])
def test_a_strip_whose_end_is_lost_is_refused_not_black(refused, kept):
    content = bytearray(packed(PATTERNS["noise"].astype(np.uint8)))
    with tifffile.TiffFile(io.BytesIO(bytes(content))) as file:
        offset, count = file.pages[0].dataoffsets[-1], file.pages[0].databytecounts[-1]
    lost = offset + int(kept * count)
    content[lost : offset + count] = bytes(offset + count - lost)
    words = refused(read_image, "a.tif", bytes(content))
    assert "corrupted strip" in words or "lzw_decode" in words
