"""NRRD files that claim what they do not hold, or point elsewhere, are refused in one line."""

import bz2
import gzip

import numpy as np
import pytest

from tomo.io import read_volume


def nrrd(data=bytes(32), **fields):
    """Return a file of 2 x 2 x 2 floats, but for the fields named; None leaves one out."""
    found = {"type": "float", "dimension": 3, "sizes": "2 2 2", "encoding": "raw"}
    found |= {"endian": "little"} | {name.replace("_", " "): v for name, v in fields.items()}
    lines = [f"{name}: {value}" for name, value in found.items() if value is not None]
    return "\n".join(["NRRD0005", *lines, "", ""]).encode() + data


def test_the_honest_one_is_read(tmp_path):
    path = tmp_path / "a.nrrd"
    path.write_bytes(nrrd(np.arange(8, dtype="<f4").tobytes()))
    expected = np.arange(8).reshape((2, 2, 2), order="F")
    np.testing.assert_array_equal(read_volume(path)[0], expected)


SIZES = [
    ("99999 99999 99999", "claim to hold 999970000299999"),
    ("9999999999999999999999 1 1", "claim to hold 10000000000000000000000"),
    ("-2 -2 2", "sizes: found [-2, -2, 2], expected three whole numbers >= 1"),
    ("0 2 2", "sizes: found [0, 2, 2]"),
    ("2 2.5 2", "sizes: found [2, 2.5, 2], expected three whole numbers >= 1"),
    ("2 2 inf", "sizes: found [2, 2, inf], expected"),
    ("nan 2 2", "not a readable volume"),
    ("a b c", "not a readable volume"),
    ("8", "sizes: found [8]"),
    (" ".join(["1"] * 30_000), "sizes: found [1, 1, 1, 1], expected three"),
    ("9" * 60_000, "expected three whole numbers"),
]


@pytest.mark.parametrize(("sizes", "words"), SIZES)
def test_sizes(refused, sizes, words):
    assert words in refused(read_volume, "a.nrrd", nrrd(sizes=sizes))


FIELDS = [
    ({"dimension": 999_999_999_999}, "expected three whole numbers"),
    ({"type": "complex"}, "found 32 bytes of type complex, encoding raw, byte skip 0, expected 8"),
    ({"type": "block"}, "found 32 bytes of type block"),
    ({"type": None}, "type: missing in the header"),
    ({"endian": "middle"}, "Invalid endian value in header: middle"),
    ({"encoding": "hex"}, "Unsupported encoding: hex"),
    ({"data": bytes(31)}, "found 31 bytes of type float, encoding raw, byte skip 0, expected 8"),
    ({"byte_skip": "99999999999999999999"}, "byte skip 99999999999999999999, expected 8 values"),
    ({"byte_skip": "-9"}, "Invalid byteskip"),
    ({"line_skip": "999999999999"}, "line skip: found 999999999999"),
    ({"line_skip": "-1"}, "line skip: found -1"),
    ({"encoding": "ascii", "data": b"1 2"}, "encoding ascii, byte skip 0, expected 8 values"),
    ({"encoding": "ascii", "data": b"1 2 x 4 5 6 7 8"}, "not a readable volume"),
    ({"spacings": "nan nan nan"}, "grid spacing: found (nan, nan, nan)"),
    ({"spacings": "-1 1 1"}, "grid spacing: found (-1.0, 1.0, 1.0)"),
    ({"spacings": "1 1"}, "spacings: found shape (2,), expected three numbers"),
    ({"space_dimension": 3, "space_origin": "(nan,2,3)"}, "grid center: found (nan, 2.5, 3.5)"),
    ({"space_dimension": 3, "space_origin": "(1,2)"}, "origin: found float64 of shape (2,)"),
    ({"space_dimension": 3, "space_directions": "(1,0,0) (0,1,0) none"}, "space directions"),
    ({"space_units": '"m m" "m m" "m m"'}, "length_unit: found 'm m', expected one word"),
    ({"space_units": '"mm" "mm" "m"'}, "space units: found ['mm', 'mm', 'm'], expected one unit"),
    ({"axis_mins": "1 2"}, "axis mins: found shape (2,), expected three numbers"),
    ({"axis_mins": "a b c"}, "not a readable volume"),
    ({"centerings": "cell cell"}, "centerings: found ['cell', 'cell'], expected cell or node"),
    ({"centers": "cell x node"}, "centerings: found ['cell', 'x', 'node'], expected cell or node"),
    (
        {"axis_mins": "0 0 0", "axis_maxs": "1 1 5", "spacings": "1 1 1"},
        "axis maxs: found 5, expected 1 by axis mins, spacings and nodes",
    ),
    (
        {"space_dimension": 3, "space_directions": "(1,0.1,0) (0,1,0) (0,0,1)"},
        "space directions: found [[1.0, 0.1, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]], expected",
    ),
    (
        {"space_dimension": 3, "space_directions": "(1,0,0) (1,0,0) (0,0,1)"},
        "space directions: found [[1.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]], expected",
    ),
]


@pytest.mark.parametrize(("fields", "words"), FIELDS)
def test_fields(refused, fields, words):
    assert words in refused(read_volume, "a.nrrd", nrrd(**fields))


@pytest.mark.parametrize(
    "field",
    [
        "data file: /etc/hostname",
        "datafile: ../../x.raw",
        "data file: LIST",
        "data file: x%03d.raw 1 999999999 1",
        "data file:=/etc/hostname",
    ],
)
def test_values_outside_the_folder_or_in_several_files(refused, field):
    content = nrrd().replace(b"\n\n", f"\n{field}\n\n".encode(), 1)
    line = refused(read_volume, "a.nrrd", content)
    assert "data file: found" in line
    assert "inside the header's folder" in line or "the name of one file" in line


ZEROS = bytes(200 << 20)
STREAMS = [
    ("gzip", gzip.compress(ZEROS, 1), None, "found compressed values of more than 64 bytes"),
    (
        "bzip2",
        bz2.compress(ZEROS[: 20 << 20], 1),
        None,
        "found compressed values of more than 64 bytes",
    ),
    ("gzip", gzip.compress(bytes(32)), "999 999 999", "claim to hold 997002999"),
    ("bzip2", bz2.compress(bytes(32)), "999 999 999", "claim to hold 997002999"),
    ("gzip", gzip.compress(bytes(32))[:15], None, "truncated"),
    ("gzip", gzip.compress(bytes(32))[:-4], None, "truncated"),
    ("bzip2", bz2.compress(bytes(32))[:-4], None, "truncated"),
    ("gzip", b"", None, "found no end of the compressed values: truncated"),
    ("gzip", b"\x1f\x8b\x08" + b"\xff" * 60, None, "not a readable volume"),
]


@pytest.mark.parametrize(("encoding", "data", "sizes", "words"), STREAMS, ids=range(len(STREAMS)))
def test_packed_values(refused, encoding, data, sizes, words):
    content = nrrd(data, encoding=encoding, sizes=sizes or "2 2 2")
    assert words in refused(read_volume, "a.nrrd", content)


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (b"", "the file is empty"),
        (b"NRRD0005\n", "type: missing in the header"),
        (b"NRRD0009\n", "version"),
        (b"\xff" * 1000, "not a readable volume"),
        (b"NRRD0005\nhello\n\n", "not a readable volume"),
        (b"NRRD0005\n" + b"#x\n" * 1_000_000, "missing in the header"),
        (nrrd().replace(b"\n\n", b"\nsizes: 9 9 9\n\n", 1), "Duplicate header field: sizes"),
    ],
    ids=range(7),
)
def test_headers(refused, content, words):
    assert words in refused(read_volume, "a.nrrd", content)
