"""LZW in TIFF files: whole ones are read, and damaged ones are not read as black."""

import io

import cv2
import numpy as np
import pytest
import tifffile

from tomo.io import read_image
from tomo.io._lzw import unpacked_length

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


def strips(content):
    with tifffile.TiffFile(io.BytesIO(content)) as file:
        page = file.pages[0]
        return list(zip(page.dataoffsets, page.databytecounts, strict=True))


@pytest.mark.parametrize("name", PATTERNS)
@pytest.mark.parametrize("dtype", [np.uint8, np.uint16])
@pytest.mark.parametrize(
    "settings",
    [(), (cv2.IMWRITE_TIFF_ROWSPERSTRIP, 7), (cv2.IMWRITE_TIFF_PREDICTOR, 2)],
    ids=["plain", "strips", "differences"],
)
def test_whole_images_are_read_and_their_lengths_are_right(tmp_path, name, dtype, settings):
    image = PATTERNS[name].astype(dtype)
    content = packed(image, *settings)
    (tmp_path / "a.tif").write_bytes(content)
    full = np.iinfo(dtype).max
    np.testing.assert_allclose(read_image(tmp_path / "a.tif"), image / full, atol=1e-7)
    found = [unpacked_length(np.frombuffer(content, np.uint8)[o : o + n]) for o, n in
             strips(content)]  # fmt: skip
    assert sum(found) == image.nbytes


@pytest.mark.parametrize("kept", [0.1, 0.5, 0.9, 0.99])
def test_a_strip_whose_end_is_lost_is_refused(tmp_path, kept):
    """OpenCV reads 8 bits a pixel by a way that does not tell, and leaves the strip black."""
    content = bytearray(packed(PATTERNS["noise"].astype(np.uint8)))
    offset, count = strips(bytes(content))[-1]
    lost = offset + int(kept * count)
    content[lost : offset + count] = bytes(offset + count - lost)
    (tmp_path / "a.tif").write_bytes(content)
    with pytest.raises(ValueError, match=r"a\.tif: .*in a strip, expected .*: damaged") as caught:
        read_image(tmp_path / "a.tif")
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("codes", "length"),
    [
        ([], 0),
        ([256, 65, 66, 257], 2),
        ([256, 65, 258, 259, 257], 1 + 2 + 3),  # each is the one before and a byte more
        ([256, 65, 300, 66], 1),  # no such code yet
        ([256, 300], 0),
        ([256, 65, 66, 256, 67, 258, 257], 2 + 1 + 2),
        ([256, 65, 66], 2),  # no end
    ],
)
def test_lengths_of_short_streams(codes, length):
    bits = "".join(f"{code:09b}" for code in codes)
    bits = bits.ljust(-(-len(bits) // 8) * 8, "0")
    stream = np.array([int(bits[at : at + 8], 2) for at in range(0, len(bits), 8)], np.uint8)
    assert unpacked_length(stream) == length


def test_any_bytes_come_to_an_end():
    for seed in range(50):
        random = np.random.default_rng(seed)
        stream = random.integers(0, 255, int(random.integers(0, 3000)), dtype=np.uint8)
        assert 0 <= unpacked_length(stream) < 1500 * len(stream) + 1
