"""Numbers of any kind and packing, over the full scale that was recorded."""

import cv2
import numpy as np
import pytest
import tifffile

from rigs.recordings import image_size, is_integer_image, read_image, read_still

RANDOM = np.random.default_rng(0)


@pytest.mark.parametrize("compression", [None, "deflate", "lzw", "packbits", "zstd"])
@pytest.mark.parametrize("bits", [10, 12, 14])
def test_packed_bits_over_their_own_full_scale(tmp_path, write_packed, bits, compression):
    image = RANDOM.integers(0, 2**bits, (7, 9), dtype=np.uint16)
    image[0, :2] = 0, 2**bits - 1
    write_packed(tmp_path / "a.tif", image, bits, compression)
    np.testing.assert_array_equal(read_still(tmp_path / "a.tif").pixels, image)
    found = read_image(tmp_path / "a.tif")
    np.testing.assert_allclose(found, image / (2**bits - 1), atol=1e-7)
    assert found[0, :2].tolist() == [0, 1]
    assert image_size(tmp_path / "a.tif") == (9, 7)


@pytest.mark.parametrize("compression", [None, "lzw", "zlib", "packbits", "zstd", "lzma"])
@pytest.mark.parametrize("kind", ["int8", "int16", "int32", "uint32", "float16", "float64"])
def test_every_kind_of_number_in_every_compression(tmp_path, kind, compression):
    """Integers over the largest of their type, floating point as it is."""
    image = (RANDOM.normal(size=(7, 9)) * 40).astype(kind if kind != "uint32" else "int32")
    image = np.abs(image).astype(kind) if kind == "uint32" else image
    full = 1.0
    if image.dtype.kind in "iu":
        full = np.iinfo(kind).max
        image[0, 0] = full
    for predictor in {False, compression is not None}:
        tifffile.imwrite(
            tmp_path / "a.tif", image, compression=compression, predictor=predictor,
            photometric="minisblack",
        )  # fmt: skip
        found = read_image(tmp_path / "a.tif")
        np.testing.assert_allclose(found, image / np.float64(full), rtol=1e-7)
        assert is_integer_image(tmp_path / "a.tif") == (image.dtype.kind in "iu")


def test_bit_depth_says_what_the_file_does_not(tmp_path):
    image = np.array([[0, 1, 2**20 - 1]], np.uint32)
    tifffile.imwrite(tmp_path / "a.tif", image, photometric="minisblack")
    assert read_image(tmp_path / "a.tif", bit_depth=20)[0, 2] == 1
    with pytest.raises(ValueError, match=r"a\.tif: bit_depth: found 33, expected 1 to 32"):
        read_image(tmp_path / "a.tif", bit_depth=33)
    with pytest.raises(
        ValueError, match="pixel of 1048575, expected at most 65535 with bit_depth"
    ):
        read_image(tmp_path / "a.tif", bit_depth=16)


def pnm(kind, numbers, full, width, gap=b"\n"):
    """Return a PGM or PPM made from the format's description alone."""
    count = len(numbers) // width // (3 if kind in (3, 6) else 1)
    head = b"P%d%s# a comment 7 7\n%d %d\n%d\n" % (kind, gap, width, count, full)
    if kind in (2, 3):
        return head + " ".join(map(str, numbers)).encode() + b"\n"
    return head + np.asarray(numbers, ">u2" if full > 255 else "u1").tobytes()


@pytest.mark.parametrize("full", [1, 9, 255, 256, 1000, 4095, 65535])
@pytest.mark.parametrize("kind", [2, 5])
def test_a_pgm_s_own_full_scale(tmp_path, kind, full):
    numbers = [0, full, full // 2, full // 3, 1, 0]
    (tmp_path / "a.pgm").write_bytes(pnm(kind, numbers, full, 3))
    still = read_still(tmp_path / "a.pgm")
    np.testing.assert_array_equal(still.pixels, np.reshape(numbers, (2, 3)))
    assert still.pixels.dtype == (np.uint8 if full < 256 else np.uint16)
    expected = np.reshape(numbers, (2, 3)) / full
    np.testing.assert_allclose(read_image(tmp_path / "a.pgm"), expected, rtol=1e-6)
    assert image_size(tmp_path / "a.pgm") == (3, 2)


@pytest.mark.parametrize("kind", [3, 6])
def test_the_colours_of_a_ppm_are_those_of_opencv(tmp_path, kind):
    numbers = RANDOM.integers(0, 256, 18).tolist()
    content = pnm(kind, numbers, 255, 3)
    (tmp_path / "a.ppm").write_bytes(content)
    expected = cv2.imdecode(np.frombuffer(content, np.uint8), cv2.IMREAD_UNCHANGED)[:, :, ::-1]
    np.testing.assert_array_equal(read_still(tmp_path / "a.ppm").pixels, expected)


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (pnm(5, [1, 2, 3, 4, 5, 6], 255, 3)[:-1], "found 5 numbers, expected 6"),
        (pnm(2, [1, 2, 3, 4, 5, 6], 255, 3)[:-3], "found 5 numbers, expected 6"),
        (pnm(2, [1, 2, "x", 4, 5, 6], 255, 3), "more than numbers"),
        (pnm(2, [1, 2, 300, 4, 5, 6], 255, 3), "found a pixel of 300, expected 0 to 255"),
        (pnm(2, [1, 2, -3, 4, 5, 6], 255, 3), "found a pixel of -3"),
        (pnm(5, [1, 2, 9, 4, 5, 6], 8, 3), "found a pixel of 9, expected 0 to 8"),
        (b"P5 0 3 255\n", "found 0 x 3 pixels"),
        (b"P5 3 3 70000\n" + bytes(18), "up to 70000"),
        (b"P5 3 3", "found no header"),
        (b"P5" + b"#" * 10000, "found no header"),
        (b"P5\n30000 30000\n255\n" + bytes(9), "claim to hold"),
        (b"P2\n30000 30000\n255\n" + b"1 " * 9, "claim to hold"),
    ],
)
def test_a_pgm_that_is_none_is_refused(refused, content, words):
    assert words in refused(read_image, "a.pgm", content)
