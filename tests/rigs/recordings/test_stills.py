"""Image files' claims, against the pixels that are decoded."""

import contextlib
import struct
import zlib

import cv2
import numpy as np
import pytest
import tifffile

from rigs.recordings import image_size, luminance, read_image, read_still

RANDOM = np.random.default_rng(0)
GREY = RANDOM.integers(0, 255, (7, 9), dtype=np.uint8)
COLOUR = RANDOM.integers(0, 255, (7, 9, 3), dtype=np.uint8)
SUFFIXES = (".png", ".jpg", ".bmp", ".pgm", ".webp", ".tif")


def read_pixels(path):
    return read_still(path).pixels


def file(suffix, image=GREY, *settings):
    """Return what OpenCV writes; colours are given red first."""
    image = image if image.ndim == 2 else image[:, :, ::-1]
    return cv2.imencode(suffix, image, settings)[1].tobytes()


@pytest.fixture
def reading(tmp_path):
    """Return a function that has one of the readers read bytes."""

    def run(read, content):
        (tmp_path / "a").write_bytes(content)
        return read(tmp_path / "a")

    return run


def png(*chunks):
    data = b"\x89PNG\r\n\x1a\n"
    for kind, content in (*chunks, (b"IEND", b"")):
        check = zlib.crc32(kind + content)
        data += struct.pack(">I", len(content)) + kind + content + struct.pack(">I", check)
    return data


@pytest.mark.parametrize("suffix", SUFFIXES)
@pytest.mark.parametrize("image", [GREY, COLOUR], ids=["grey", "colour"])
def test_size_and_pixels_are_those_of_opencv(reading, suffix, image):
    data = file(".ppm" if suffix == ".pgm" and image.ndim == 3 else suffix, image)
    assert reading(image_size, data) == (9, 7)
    expected = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_UNCHANGED)
    expected = expected if expected.ndim == 2 else expected[:, :, ::-1]
    found = reading(read_pixels, data)
    np.testing.assert_array_equal(found, expected)
    assert found.dtype == np.uint8


@pytest.mark.parametrize("suffix", [".png", ".pgm", ".tif"])
def test_sixteen_bits_stay(reading, suffix):
    for image in (GREY, COLOUR):
        wide = image.astype(np.uint16) * 257
        data = file(".ppm" if suffix == ".pgm" and image.ndim == 3 else suffix, wide)
        if suffix != ".pgm" or image.ndim == 2:
            found = reading(read_pixels, data)
            np.testing.assert_array_equal(found, wide)
            assert found.dtype == np.uint16


def test_one_bit_is_black_and_white_in_every_format(reading, tmp_path):
    mask = GREY > 100
    tifffile.imwrite(tmp_path / "a.tif", mask, photometric="minisblack")
    png_mask = file(".png", mask * np.uint8(255), cv2.IMWRITE_PNG_BILEVEL, 1)
    for found in (read_pixels(tmp_path / "a.tif"), reading(read_pixels, png_mask)):
        np.testing.assert_array_equal(found, mask * 255)
        assert found.dtype == np.uint8
    np.testing.assert_array_equal(read_image(tmp_path / "a.tif"), mask)


def test_colour_planes_of_a_tiff_become_channels(tmp_path):
    planes = np.moveaxis(COLOUR, -1, 0)
    tifffile.imwrite(tmp_path / "a.tif", planes, photometric="rgb", planarconfig="separate")
    np.testing.assert_array_equal(read_pixels(tmp_path / "a.tif"), COLOUR)


def test_luminance_is_that_of_opencv():
    expected = cv2.cvtColor(COLOUR, cv2.COLOR_RGB2GRAY)
    np.testing.assert_array_equal(luminance(COLOUR), expected)
    np.testing.assert_array_equal(luminance(np.dstack([COLOUR, GREY])), expected)
    np.testing.assert_array_equal(luminance(np.dstack([GREY, 255 - GREY])), GREY)
    np.testing.assert_array_equal(luminance(GREY), GREY)


def test_a_lossy_webp_and_an_image_with_a_comment(reading):
    assert reading(image_size, file(".webp", GREY, cv2.IMWRITE_WEBP_QUALITY, 50)) == (9, 7)
    assert reading(image_size, b"P5\n# made by hand\n9 7\n255\n" + bytes(63)) == (9, 7)


OTHER = "damaged, or none of PNG, JPEG"
TOO_LARGE = "claim to hold|exceeds limit"


@pytest.mark.parametrize(
    ("data", "message"),
    [
        (b"", "the file is empty"),
        (b"text", OTHER),
        (b"GIF89a" + bytes(50), OTHER),
        (file(".png")[:-16], "damaged or truncated"),
        (file(".jpg")[:-3], "damaged or truncated"),
        (file(".bmp")[:20], ""),
        (file(".bmp")[:-9], "truncated"),
        (file(".pgm")[:-9], "truncated"),
        (file(".webp")[:-9], ""),
        (file(".tif")[:9], ""),
        (b"II+\0\x08\0\0\0" + b"\xff" * 60, ""),
        (png((b"IHDR", struct.pack(">2I5B", 40000, 40000, 8, 0, 0, 0, 0))), TOO_LARGE),
        (png((b"IHDR", struct.pack(">2I5B", 9000, 9000, 8, 0, 0, 0, 0))), TOO_LARGE),
        (
            file(".bmp").replace(struct.pack("<2i", 9, 7), struct.pack("<2i", 30000, 30000)),
            TOO_LARGE,
        ),
        (b"P5\n30000 30000\n255\n" + bytes(9), TOO_LARGE),
        (b"P5\n#x\r30000 30000\n8 8 255\n" + bytes(64), TOO_LARGE),
    ],
    ids=range(16),
)
def test_what_is_none_or_claims_too_much_is_refused(refused, data, message):
    words = refused(read_pixels, "a", data)
    assert words.startswith("not a readable image: ")
    assert any(part in words for part in message.split("|"))


def test_a_mask_of_60_megapixels_is_read_though_it_packs_to_nothing(reading):
    data = file(".png", np.full((6336, 9504), 255, np.uint8))
    assert len(data) < 100_000
    assert reading(read_pixels, data).shape == (6336, 9504)


@pytest.mark.parametrize("suffix", SUFFIXES)
def test_libraries_write_nothing_on_the_terminal(reading, capfd, suffix):
    content = bytearray(file(suffix, RANDOM.integers(0, 255, (40, 40), dtype=np.uint8)))
    for damaged in (content[: len(content) // 2], content[:600] + bytes(40) + content[640:]):
        with contextlib.suppress(ValueError):
            reading(read_pixels, bytes(damaged))
    assert capfd.readouterr() == ("", "")
