"""TIFF files that claim what they do not hold are refused before anything is made of it."""

import io
import logging
import struct
import zlib

import cv2
import numpy as np
import pytest
import tifffile

from rigs.recordings import read_image

KINDS = {1: "B", 3: "H", 4: "I", 8: "h", 9: "i"}
WIDTH, LENGTH, BITS, COMPRESSION, LIGHT, OFFSETS = 256, 257, 258, 259, 262, 273
SAMPLES, ROWS, COUNTS, PREDICTOR, TILE_WIDTH, TILE_LENGTH = 277, 278, 279, 317, 322, 323
TILE_OFFSETS, TILE_COUNTS, SAMPLE_FORMAT, DEPTH = 324, 325, 339, 32997
DEFLATE, LZW, PACKBITS = 8, 5, 32773
BEHIND = object()  # the place behind the tags, where the pixels are


def tiff(data=bytes(64), next_page=0, **tags):
    """Return a file of 8 x 8 grey pixels, but for the tags that are named, like ``WIDTH=(4, 9)``.

    A tag is its kind and its value, or its kind, its count and where its values are.
    """
    found = {
        WIDTH: (4, 8), LENGTH: (4, 8), BITS: (3, 8), COMPRESSION: (3, 1), LIGHT: (3, 1),
        OFFSETS: (4, BEHIND), SAMPLES: (3, 1), ROWS: (4, 8), COUNTS: (4, len(data)),
    }  # fmt: skip
    found |= {globals()[name]: value for name, value in tags.items()}
    behind = 8 + 2 + 12 * len(found) + 4
    content = b"II" + struct.pack("<HIH", 42, 8, len(found))
    for tag, (kind, *count, value) in sorted(found.items()):
        value = behind if value is BEHIND else value
        code = "I" if count else KINDS[kind]
        content += struct.pack("<HHI", tag, kind, *(count or [1]))
        content += struct.pack(f"<{code}", value).ljust(4, b"\0")
    return content + struct.pack("<I", next_page) + data


def test_the_honest_one_is_read(tmp_path):
    (tmp_path / "a.tif").write_bytes(tiff(bytes(range(64))))
    expected = np.arange(64).reshape(8, 8) / 255
    np.testing.assert_allclose(read_image(tmp_path / "a.tif"), expected, rtol=1e-6)


PIXELS = [
    ({"WIDTH": (4, 2**32 - 1), "LENGTH": (4, 2**32 - 1)}, "found 1 strips"),
    ({"WIDTH": (4, 2**32 - 1), "ROWS": (4, 2**32 - 1)}, "claim to hold 34359738360"),
    ({"WIDTH": (4, 8000), "LENGTH": (4, 8000), "ROWS": (4, 8000)}, "read 64000000 bytes, got 64"),
    ({"WIDTH": (9, -8)}, "found -8 x 8 pixels, expected some"),
    ({"LENGTH": (8, -8)}, "found 8 x -8 pixels"),
    ({"WIDTH": (4, 0)}, "found 0 x 8 pixels"),
    ({"DEPTH": (4, 2**31)}, "found 1 strips"),
    ({"SAMPLES": (3, 60000)}, "read 3840000 bytes, got 64"),
    ({"BITS": (3, 0)}, "found 0 bits a sample of kind 1"),
    ({"BITS": (3, 65535)}, "found 65535 bits a sample"),
    ({"SAMPLE_FORMAT": (3, 9)}, "found 8 bits a sample of kind 9, expected 1 to 32"),
    ({"SAMPLE_FORMAT": (3, 6), "BITS": (3, 64), "data": bytes(512)}, "found complex64 pixels"),
    ({"SAMPLE_FORMAT": (3, 2), "BITS": (3, 64), "data": bytes(512)}, "found int64 pixels"),
]
STRIPS = [
    ({"OFFSETS": (4, 10**9)}, "expected 1000000064: truncated"),
    ({"OFFSETS": (4, 0)}, "found a strip without bytes"),
    ({"COUNTS": (4, 0)}, "found a strip without bytes, expected all of the image"),
    ({"COUNTS": (4, 2**32 - 1)}, "truncated"),
    ({"OFFSETS": (4, 2**31, 16)}, "found 0 strips, 1 sizes, expected 1"),
    ({"ROWS": (4, 1)}, "found 1 strips, 1 sizes, expected 8"),
    ({"ROWS": (4, 0)}, "rowsperstrip"),
    ({"data": bytes(63)}, "damaged or truncated: failed to read 64 bytes, got 63"),
    (
        {"TILE_WIDTH": (4, 0), "TILE_LENGTH": (4, 0), "TILE_OFFSETS": (4, 200)},
        "not a readable image",
    ),
    ({"COMPRESSION": (3, 50000)}, "damaged or truncated: ZSTD"),
    ({"COMPRESSION": (3, 4)}, "damaged or truncated: "),
]
LARGE = {"WIDTH": (4, 8000), "LENGTH": (4, 8000), "ROWS": (4, 8000)}
PACKED = [
    ({"COMPRESSION": (3, DEFLATE), "data": zlib.compress(bytes(64)), **LARGE}, "corrupted strip"),
    ({"COMPRESSION": (3, PACKBITS), "data": b"\0\1", **LARGE}, "corrupted strip"),
    ({"COMPRESSION": (3, LZW), "data": b"\x80\1\2", **LARGE}, "corrupted strip"),
    ({"COMPRESSION": (3, DEFLATE), "data": zlib.compress(bytes(64))[:9]}, "not a readable image"),
    ({"COMPRESSION": (3, DEFLATE), "data": zlib.compress(bytes(32))}, "corrupted strip"),
    (
        {"COMPRESSION": (3, DEFLATE), "data": zlib.compress(bytes(32 << 20))},
        "damaged or truncated: libdeflate",
    ),
]


@pytest.mark.parametrize(("tags", "words"), PIXELS + STRIPS + PACKED)
def test_tags_that_say_what_is_not_there(refused, tags, words):
    assert words in refused(read_image, "a.tif", tiff(**tags))


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (b"II*\0\x08\0\0\0\xff\xff" + bytes(100), "suspicious number of tags 65535"),
        (b"II+\0\x08\0\0\0" + struct.pack("<QQ", 16, 2**60) + bytes(100), "number of tags"),
        (b"II*\0\xff\xff\xff\xff", "found no page, expected one"),
        (tiff(next_page=8), "found more than one page, expected one"),  # the same for ever
        (b"\x89PNG\r\n\x1a\n" + bytes(100), "damaged, or none of PNG"),
    ],
)
def test_headers_that_lead_nowhere(refused, content, words):
    assert words in refused(read_image, "a.tif", content)


def test_a_long_chain_of_pages_is_not_followed(refused):
    page = struct.pack("<HHHII", 1, WIDTH, 4, 1, 8)
    count = 200_000
    size = len(page) + 4
    chain = b"".join(page + struct.pack("<I", 8 + (n + 1) * size) for n in range(count))
    content = b"II*\0\x08\0\0\0" + chain
    assert "found more than one page" in refused(read_image, "a.tif", content)


def test_a_file_that_names_another_is_read_by_itself(tmp_path):
    """OME's metadata may say that the pixels are in a file elsewhere."""
    pixels = '<Pixels DimensionOrder="XYZCT" Type="uint8" SizeX="3" SizeY="2" SizeZ="1" SizeC="1"'
    named = '<TiffData><UUID FileName="../../secret.tif">urn:uuid:1</UUID></TiffData>'
    space = "http://www.openmicroscopy.org/Schemas/OME/2016-06"
    text = f'<OME xmlns="{space}"><Image>{pixels} SizeT="1">{named}</Pixels></Image></OME>'
    image = np.array([[0, 1, 2], [3, 4, 255]], np.uint8)
    path = tmp_path / "a" / "b" / "a.ome.tif"
    path.parent.mkdir(parents=True)
    tifffile.imwrite(tmp_path / "secret.tif", image[::-1])
    tifffile.imwrite(path, image, description=text, metadata=None)
    np.testing.assert_allclose(read_image(path), image / 255, rtol=1e-6)


def test_what_the_library_logs_of_it_stays_off_the_terminal(refused, capsys):
    refused(read_image, "a.tif", tiff(OFFSETS=(4, 2**31, 16)))
    assert capsys.readouterr().err == ""
    assert not logging.getLogger("tifffile").handlers


@pytest.mark.parametrize("kept", [0.1, 0.5, 0.9, 0.99])
def test_a_strip_whose_end_is_lost_is_refused_not_black(refused, kept):
    noise = np.random.default_rng(0).integers(0, 255, (190, 170), dtype=np.uint8)
    content = bytearray(
        cv2.imencode(".tif", noise, [cv2.IMWRITE_TIFF_COMPRESSION, LZW])[1].tobytes()
    )
    with tifffile.TiffFile(io.BytesIO(bytes(content))) as file:
        offset, count = file.pages[0].dataoffsets[-1], file.pages[0].databytecounts[-1]
    lost = offset + int(kept * count)
    content[lost : offset + count] = bytes(offset + count - lost)
    words = refused(read_image, "a.tif", bytes(content))
    assert "corrupted strip" in words or "lzw_decode" in words
