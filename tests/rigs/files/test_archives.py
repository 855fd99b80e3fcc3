"""Archives and packed streams that claim more than they hold."""

import bz2
import gzip
import io
import zipfile
import zlib

import numpy as np
import pytest

from rigs.files import archives
from rigs.files.archives import check_unpacked, inflated, most_unpacked, read_arrays, unzipped


def archive(path, method=zipfile.ZIP_DEFLATED, **members):
    with zipfile.ZipFile(path, "w", method) as file:
        for name, content in members.items():
            file.writestr(f"{name}.npy", content)
    return path


def npy(array, **header):
    """An .npy file whose header says something else."""
    file = io.BytesIO()
    said = np.lib.format.header_data_from_array_1_0(array) | header
    np.lib.format.write_array_header_1_0(file, said)
    return file.getvalue() + array.tobytes()


@pytest.mark.parametrize("order", ["C", "F"])
@pytest.mark.parametrize("save", [np.savez, np.savez_compressed])
def test_arrays_come_back_as_they_were(tmp_path, save, order):
    rng = np.random.default_rng(0)
    arrays = {
        "a": np.array(rng.normal(size=(3, 4, 5)), order=order),
        "b": np.arange(7, dtype=">i2"),
        "c": np.array("mm"),
        "d": np.zeros((0, 3)),
        "e": np.array(["x", "yz"]),
    }
    save(tmp_path / "a.npz", **arrays)
    found = read_arrays(tmp_path / "a.npz")
    assert list(found) == list(arrays)
    for name, array in arrays.items():
        np.testing.assert_array_equal(found[name], array)
        assert found[name].dtype == array.dtype
    found["a"][0] = 1  # they are nobody else's


@pytest.mark.parametrize(
    ("header", "message"),
    [
        ({"shape": (10**10,)}, "found 80 bytes of values, expected float64"),
        ({"shape": (5,)}, "found 80 bytes"),
        ({"shape": (-10,)}, "found 80 bytes"),
        ({"shape": (-2, -5)}, "found 80 bytes"),
        ({"descr": "|O"}, "found Python objects"),
        ({"descr": "<U100000000"}, "found 80 bytes"),
        ({"descr": "<U0", "shape": (10**9,)}, "found values of no bytes"),
        ({"descr": "|S0", "shape": (10**9,)}, "found values of no bytes"),
        ({"descr": [], "shape": (10**9,)}, "found values of no bytes"),
        ({"descr": [("a", "|O")]}, "found Python objects"),
    ],
)
def test_a_header_that_claims_something_else_is_refused(tmp_path, header, message):
    path = archive(tmp_path / "a.npz", a=npy(np.zeros(10), **header))
    with pytest.raises(ValueError, match=f"not a readable .npz: .*{message}") as caught:
        read_arrays(path)
    assert "\n" not in str(caught.value)


def test_an_archive_that_unpacks_to_far_more_is_refused(tmp_path, monkeypatch):
    monkeypatch.setattr(archives, "FREE", 1 << 16)
    large = np.random.default_rng(0).normal(size=100_000)
    assert read_arrays(archive(tmp_path / "a.npz", a=npy(large)))["a"].nbytes == 800_000
    path = archive(tmp_path / "b.npz", a=npy(np.zeros(100_000)))
    with pytest.raises(ValueError, match=r"bytes that unpack to 8001.., expected at most"):
        read_arrays(path)
    stored = archive(tmp_path / "c.npz", zipfile.ZIP_STORED, a=npy(np.zeros(100_000)))
    assert not read_arrays(stored)["a"].any()


@pytest.mark.parametrize("method", [zipfile.ZIP_BZIP2, zipfile.ZIP_LZMA])
def test_packings_that_numpy_does_not_write_are_refused(tmp_path, method):
    path = archive(tmp_path / "a.npz", method, a=npy(np.zeros(3)))
    with pytest.raises(ValueError, match="another compression"):
        read_arrays(path)


@pytest.mark.parametrize("content", [b"", b"PK\x03\x04", b"\x93NUMPY", b"x" * 99])
def test_what_is_no_archive_is_refused(tmp_path, content):
    (tmp_path / "a.npz").write_bytes(content)
    with pytest.raises(ValueError, match=r"not a readable \.npz"):
        read_arrays(tmp_path / "a.npz")


@pytest.mark.parametrize(("pack", "unpack"), [(zlib.compress, inflated), (bz2.compress, unzipped)])
def test_streams_give_what_is_expected_and_no_more(pack, unpack):
    data = bytes(range(256)) * 10
    assert unpack(pack(data), len(data)) == data
    for count in (0, 1, len(data) - 1, len(data) + 1):
        with pytest.raises(ValueError, match="bytes of values, expected"):
            unpack(pack(data), count)
    with pytest.raises(ValueError, match="unpack to"):
        unpack(pack(data), 10**10)


@pytest.mark.parametrize(("pack", "unpack"), [(zlib.compress, inflated), (bz2.compress, unzipped)])
@pytest.mark.parametrize("count", [-1, -2, -(10**9)])
def test_fewer_bytes_than_none_are_refused_before_anything_is_unpacked(pack, unpack, count):
    """Such a limit is no limit to the libraries."""
    with pytest.raises(ValueError, match=f"found {count} bytes to unpack to"):
        unpack(pack(bytes(1000)), count)


@pytest.mark.parametrize("lost", [1, 4, 8])
@pytest.mark.parametrize("pack", [zlib.compress, gzip.compress])
def test_a_stream_without_its_end_is_refused_though_all_values_are_there(pack, lost):
    """The end tells whether the values are right."""
    data = bytes(range(256)) * 10
    with pytest.raises(ValueError, match=r"truncated|bytes of values, expected"):
        inflated(pack(data)[:-lost], len(data))


def test_measured_fields_are_far_from_the_limit():
    smooth = np.exp(-(np.linspace(-2, 2, 60_000, dtype=np.float32) ** 2))
    stored = len(zlib.compress(smooth.tobytes()))
    assert smooth.nbytes < most_unpacked(stored) - archives.FREE
    check_unpacked(archives.FREE, 0)
    with pytest.raises(ValueError, match="damaged, or to be stored without compression"):
        check_unpacked(archives.FREE + 1, 0)
