"""Images in TIFF files as cameras pack them, which no writer at hand makes."""

import struct
import sys
import zlib
from pathlib import Path

import imagecodecs
import numpy as np
import pytest
import tifffile

sys.path.append(str(Path(__file__).parent))  # the tests import `film_files`

COMPRESSIONS = {
    None: (1, bytes),
    "deflate": (8, zlib.compress),
    "lzw": (5, imagecodecs.lzw_encode),
    "packbits": (32773, imagecodecs.packbits_encode),
    "zstd": (50000, imagecodecs.zstd_encode),
}


def packed_rows(image, bits):
    """Return rows of ``bits`` a pixel, the high bit first, each row from a new byte."""
    places = np.arange(bits - 1, -1, -1)
    ones = (image[..., None].astype(np.int64) >> places & 1).astype(np.uint8)
    return np.packbits(ones.reshape(len(image), -1), axis=1).tobytes()


@pytest.fixture(scope="session")
def write_packed():
    """Return a function that writes an image of so many bits a pixel, compressed or not."""

    def write(path, image, bits, compression=None):
        tifffile.imwrite(path, image, bitspersample=bits, photometric="minisblack", metadata=None)
        code, pack = COMPRESSIONS[compression]
        data = pack(packed_rows(image, bits))
        with tifffile.TiffFile(path) as file:
            (page,) = file.pages
            start = page.dataoffsets[0]
            at = {tag: page.tags[tag].valueoffset for tag in (259, 279)}
        content = bytearray(path.read_bytes()[:start] + data)
        struct.pack_into("<H", content, at[259], code)
        struct.pack_into("<I", content, at[279], len(data))
        path.write_bytes(content)

    return write
