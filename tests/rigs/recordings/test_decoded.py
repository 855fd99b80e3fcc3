"""What image files claim, against what is decoded."""

import struct
import time
import zlib

import cv2
import numpy as np
import pytest

from rigs.recordings.decoded import decoded, size_of

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


def claims(width, height):
    """Return a JPEG frame header."""
    return b"\xff\xc0" + struct.pack(">HB2HB", 11, 8, height, width, 1) + b"\1\x11\0"


@pytest.mark.parametrize("marker", [0x01, 0xD0, 0xD7])
def test_a_jpeg_marker_without_a_length_does_not_hide_the_frame_header(marker):
    """Decoders go straight on behind it, and would decode the first header, not the second."""
    large = claims(20_000, 20_000)
    (skipped,) = struct.unpack_from(">H", large)
    data = b"\xff\xd8\xff" + bytes([marker]) + large
    data = data.ljust(4 + skipped, b"\0") + claims(8, 8) + b"\xff\xd9"
    assert size_of(data) == (20_000, 20_000)
    with pytest.raises(ValueError, match="unpack to 1600000000"):
        decoded(data)


@pytest.mark.parametrize("filling", [b"\0", b"\xff", b"\xff\0"])
def test_a_jpeg_without_a_frame_header_is_seen_through_at_once(filling):
    began = time.process_time()
    with pytest.raises(ValueError, match="found no size in its header"):
        size_of(b"\xff\xd8" + filling * ((40 << 20) // len(filling)))
    assert time.process_time() - began < 1


def tagged(*tags, order="<", big=False):
    """Return the start of a TIFF with tags of ``(number, kind, value)``."""
    head, count, entry = ("HHHQ", "Q", "HHQ8s") if big else ("HI", "H", "HHI4s")
    start = (43, 8, 0, 16) if big else (42, 8)
    data = (b"II" if order == "<" else b"MM") + struct.pack(order + head, *start)
    data += struct.pack(order + count, len(tags))
    codes = {1: "B", 3: "H", 4: "I", 9: "i", 16: "Q", 17: "q"}
    for number, kind, value in tags:
        packed = struct.pack(order + codes.get(kind, "I"), value)
        data += struct.pack(order + entry, number, kind, 1, packed)
    return data + bytes(8)


@pytest.mark.parametrize("order", ["<", ">"])
def test_a_tiff_s_size_in_any_kind_of_whole_number(order):
    for kind in (3, 4, 9):
        assert size_of(tagged((256, kind, 40), (257, kind, 30), order=order)) == (40, 30)
    for kind in (3, 4, 16, 17):
        tags = (256, kind, 40), (257, kind, 30)
        assert size_of(tagged(*tags, order=order, big=True)) == (40, 30)


@pytest.mark.parametrize(
    "data",
    [
        tagged((256, 4, 40_000), (256, 4, 8), (257, 4, 8)),  # which of them holds?
        tagged((256, 4, 8), (257, 4, 40_000), (257, 4, 8)),
        tagged((256, 12, 8), (257, 4, 8)),  # a floating-point width
        tagged((256, 4, 8), (257, 16, 8)),  # too large to stand in its place
        tagged((256, 9, -8), (257, 9, -8)),
        tagged(*[(1, 4, 0)] * 4096, (256, 4, 8), (257, 4, 8)),
    ],
)
def test_a_tiff_whose_size_is_not_plain_is_refused(data):
    with pytest.raises(ValueError, match="found no size in its header"):
        size_of(data)


def test_a_comment_ends_where_decoders_say_it_does():
    data = b"P5\n#x\r30000 30000\n8 8 255\n" + bytes(64)
    assert size_of(data) == (30000, 30000)


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
