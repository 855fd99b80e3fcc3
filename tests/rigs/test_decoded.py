"""What image files claim, against what is decoded."""

import struct
import zlib

import cv2
import numpy as np
import pytest

from rigs._decoded import decoded, size_of

GREY = np.random.default_rng(0).integers(0, 255, (7, 9), dtype=np.uint8)
SUFFIXES = (".png", ".jpg", ".bmp", ".pgm", ".webp", ".tif")


def file(suffix, image=GREY, *settings):
    return cv2.imencode(suffix, image, settings)[1].tobytes()


def png(*chunks):
    data = b"\x89PNG\r\n\x1a\n"
    for kind, content in (*chunks, (b"IEND", b"")):
        check = zlib.crc32(kind + content)
        data += struct.pack(">I", len(content)) + kind + content + struct.pack(">I", check)
    return data


@pytest.mark.parametrize("suffix", SUFFIXES)
@pytest.mark.parametrize("channels", [1, 3])
def test_size_and_pixels(suffix, channels):
    image = GREY if channels == 1 else np.dstack([GREY] * 3)
    data = file(".ppm" if (suffix, channels) == (".pgm", 3) else suffix, image)
    assert size_of(data) == (9, 7)
    assert decoded(data).shape[:2] == (7, 9)


def test_a_lossy_webp_and_an_image_with_a_comment():
    assert size_of(file(".webp", GREY, cv2.IMWRITE_WEBP_QUALITY, 50)) == (9, 7)
    assert size_of(b"P5\n# made by hand\n9 7\n255\n" + bytes(63)) == (9, 7)


@pytest.mark.parametrize(
    ("data", "message"),
    [
        (b"", "damaged, empty or of another format"),
        (b"text", "damaged, empty or of another format"),
        (b"GIF89a" + bytes(50), "damaged, empty or of another format"),
        (file(".png")[:-12], "no end mark"),
        (file(".jpg")[:-2], "no end mark"),
        (file(".bmp")[:20], "no size in its header"),
        (file(".tif")[:9], "no size in its header"),
        (b"II+\0\x08\0\0\0" + b"\xff" * 60, "no size in its header"),
        (
            png((b"IHDR", struct.pack(">2I5B", 40000, 40000, 8, 0, 0, 0, 0))),
            "unpack to 3200000000",
        ),
        (
            file(".bmp").replace(struct.pack("<2i", 9, 7), struct.pack("<2i", 30000, 30000)),
            "unpack",
        ),
        (b"P5\n30000 30000\n255\n" + bytes(9), "unpack to"),
    ],
)
def test_what_is_none_or_claims_too_much_is_refused(data, message):
    with pytest.raises(ValueError, match=message) as caught:
        decoded(data)
    assert "\n" not in str(caught.value)


def test_a_jpeg_of_a_size_that_it_cannot_have_is_refused():
    data = file(".jpg")
    at = data.index(b"\xff\xc0") + 5
    with pytest.raises(ValueError, match="unpack to 4096000000"):
        decoded(data[:at] + struct.pack(">2H", 32000, 32000) + data[at + 4 :])


def test_a_chunk_longer_than_the_file_is_refused():
    """OpenCV asks for that much memory, and takes seconds to fill it."""
    data = file(".png")
    at = data.index(b"IDAT") - 4
    for length in (0xFF000000, len(data), 2**31):
        with pytest.raises(ValueError, match=f"found a chunk of {length} bytes"):
            decoded(data[:at] + struct.pack(">I", length) + data[at + 4 :])


def test_a_mask_of_60_megapixels_is_read_though_it_packs_to_nothing():
    data = file(".png", np.full((6336, 9504), 255, np.uint8))
    assert len(data) < 100_000
    assert decoded(data).shape == (6336, 9504)
