"""VTK files that claim what they do not hold, or point elsewhere, are refused in one line."""

import base64
import itertools
import zlib

import numpy as np
import pytest

from tomo.io import read_volume

EIGHT = '<DataArray type="Float32" format="ascii">1 2 3 4 5 6 7 8</DataArray>'
ZLIB = 'compressor="vtkZLibDataCompressor"'
BOMB = zlib.compress(bytes(200 << 20), 1)


def vti(array=EIGHT, file="", image="", extent="0 1 0 1 0 1", behind="", order="LittleEndian"):
    return (
        f'<VTKFile type="ImageData" byte_order="{order}" {file}><ImageData {image}>'
        f'<Piece Extent="{extent}"><PointData>{array}</PointData></Piece></ImageData>{behind}'
        "</VTKFile>"
    ).encode()


def inline(dtype, numbers, data=b""):
    """Return an array whose numbers, of sizes or blocks, stand before its bytes."""
    text = base64.b64encode(np.array(numbers, dtype).tobytes()) + base64.b64encode(data)
    return f'<DataArray type="Float32" format="binary">{text.decode()}</DataArray>'


def appended(offset, data="A" * 64):
    return {
        "array": f'<DataArray type="Float32" format="appended" offset="{offset}"/>',
        "behind": f'<AppendedData encoding="raw">_{data}</AppendedData>',
    }


@pytest.mark.parametrize("content", [vti(), vti().replace(b'byte_order="LittleEndian"', b"")])
def test_the_honest_one_is_read(tmp_path, content):
    (tmp_path / "a.vti").write_bytes(content)
    expected = np.arange(1, 9).reshape((2, 2, 2), order="F")
    np.testing.assert_array_equal(read_volume(tmp_path / "a.vti")[0], expected)


EXTENTS = [
    ("0 99999 0 99999 0 99999", "found 8 values, expected 100000 x 100000 x 100000"),
    ("0 4294967295 0 4294967295 0 0", "found 8 values"),  # 2^64 voxels
    ("0 99999999999999999999999 0 1 0 1", "Extent: found"),
    ("0 -5 0 1 0 1", "found 8 values, expected -4 x 2 x 2"),
    ("3 1 3 1 0 1", "expected -1 x -1 x 2"),
    ("-9223372036854775808 9223372036854775807 0 1 0 1", "expected 0 x 2 x 2"),
    ("0 1 0 1", "Extent: found '0 1 0 1', expected 6 whole numbers"),
    ("", "Extent: found '', expected 6 whole numbers"),
]


@pytest.mark.parametrize(("extent", "words"), EXTENTS)
def test_extents(refused, extent, words):
    assert words in refused(read_volume, "a.vti", vti(extent=extent))


ATTRIBUTES = [
    ({"image": 'Spacing="-1 1 1"'}, "grid spacing: found (-1.0, 1.0, 1.0)"),
    ({"image": 'Spacing="nan 1 1"'}, "grid spacing: found (nan, 1.0, 1.0)"),
    ({"image": 'Spacing="2"'}, "Spacing: found '2', expected 3 numbers"),
    ({"image": 'Origin="inf 1 1"'}, "grid center: found (inf, 1.5, 1.5)"),
    ({"image": 'Origin="1"'}, "Origin: found '1', expected 3 numbers"),
    ({"image": 'Direction="1 0"'}, "Direction: found '1 0', expected 9 numbers"),
    ({"image": 'Direction="0.6 0.8 0 -0.8 0.6 0 0 0 1"'}, "Direction: found [[0.6, -0.8"),
    ({"image": 'Direction="0 0 0 0 0 0 0 0 0"'}, "Direction: found [[0.0, 0.0"),
    ({"file": 'header_type="Int32"'}, "header_type: found 'Int32', expected one of UInt32"),
    ({"file": 'header_type="Float64"'}, "header_type: found 'Float64'"),
    ({"file": 'compressor="x"', "array": inline("<u4", [1])}, "found compressor x"),
    ({"order": "Middle"}, "byte_order: found 'Middle', expected one of LittleEndian, BigEndian"),
    ({"array": EIGHT.replace("Float32", "Float128")}, "type: found 'Float128', expected one of"),
    ({"array": EIGHT.replace('type="Float32"', "")}, "type: found ''"),
    ({"array": EIGHT.replace("8", "")}, "found 7 values, expected 2 x 2 x 2"),
    ({"array": EIGHT.replace("8", "x")}, "not a readable volume"),
    ({"array": EIGHT.replace("8", "9" * 200_000)}, "NaN or infinite"),
    ({"array": EIGHT.replace("format", 'NumberOfComponents="-1" format')}, "several components"),
    ({"array": ""}, "found no DataArray"),
    (appended(0), "found 64 bytes, expected 1094795589: truncated"),
    (appended(-40), "offset: found -40, expected one inside the 64 bytes"),
    (appended(99999999999), "offset: found 99999999999"),
    (appended("x"), "offset: found 'x'"),
    (appended(0) | {"behind": ""}, "offset: found 0, expected one inside the 0 bytes"),
]


@pytest.mark.parametrize(("parts", "words"), ATTRIBUTES)
def test_attributes(refused, parts, words):
    assert words in refused(read_volume, "a.vti", vti(**parts))


WIDE = f'{ZLIB} header_type="UInt64"'
BYTES = [
    ("", inline("<u4", [2**31], b"abc"), "expected 2147483652: truncated"),
    ("", inline("<u4", [33], bytes(33)), "truncated"),
    ("", '<DataArray type="Float32" format="binary">A</DataArray>', "not a readable volume"),
    ("", '<DataArray type="Float32" format="binary">!!!!!!!!</DataArray>', "truncated"),
    (ZLIB, inline("<u4", [2**32 - 1, 1 << 20, 0]), "truncated"),
    (WIDE, inline("<u8", [2**63, 1 << 20, 0]), "truncated"),
    (ZLIB, inline("<u4", [0, 32, 0]), "found 0 values"),
    (ZLIB, inline("<u4", [1, 200 << 20, 0, len(BOMB)], BOMB), "claim to hold 209715200"),
    (
        ZLIB,
        inline("<u4", [1, 32, 0, len(BOMB)], BOMB),
        "found compressed values of more than 32 bytes",
    ),
    (WIDE, inline("<i8", [1, -1, 0, len(BOMB)], BOMB), "claim to hold 18446744073709551615"),
    (ZLIB, inline("<u4", [1, 32, 0, 9], zlib.compress(bytes(32))[:9]), "truncated"),
]


@pytest.mark.parametrize(("file", "array", "words"), BYTES, ids=range(len(BYTES)))
def test_encoded_bytes(refused, file, array, words):
    assert words in refused(read_volume, "a.vti", vti(array, file))


def nested_entities():
    """Return entities of which the last, x, stands for 40 GB of text."""
    levels = "abcdefghij" + "x"
    first = '<!ENTITY a "aaaaaaaaaa">'
    others = (f'<!ENTITY {b} "{f"&{a};" * 10}">' for a, b in itertools.pairwise(levels))
    return "".join((first, *others)).encode()


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (b'<!DOCTYPE a [<!ENTITY x SYSTEM "file:///etc/hostname">]>', "undefined entity &x;"),
        (b"<!DOCTYPE a [%s]>" % nested_entities(), "amplification"),
    ],
)
def test_entities(refused, content, words):
    content += vti(EIGHT.replace("8", "&x;"))
    assert words in refused(read_volume, "a.vti", content)


@pytest.mark.parametrize(
    "content",
    [
        b"",
        b"<VTKFile",
        vti().replace(b"ImageData", b"PolyData"),
        vti()[:-5],
        b"<a>" * 50_000,
        b"<a>" * 50_000 + b"</a>" * 50_000,
        b"<VTKFile " + b" ".join(b'a%d="1"' % n for n in range(20_000)) + b"/>",
        b'<VTKFile type="PImageData"><Piece Source="../x.vti"/></VTKFile>',
        b'<AppendedData encoding="raw">_',
        b"<AppendedData " * 50_000,
    ],
    ids=range(10),
)
def test_what_is_no_image_data(refused, content):
    assert "not a readable volume" in refused(read_volume, "a.vti", content)
