"""Archives that claim more than they hold."""

import io
import zipfile

import numpy as np
import pytest

from rigs.files import size_guard
from rigs.files.size_guard import read_arrays


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
        ({"shape": (-2, -5)}, ""),
        ({"descr": "|O"}, "Object arrays cannot be loaded"),
        ({"descr": "<U100000000"}, "found 80 bytes"),
        ({"descr": "<U0", "shape": (10**9,)}, "found 80 bytes of values"),
        ({"descr": "|S0", "shape": (10**9,)}, "found 80 bytes of values"),
        ({"descr": [], "shape": (10**9,)}, "found 80 bytes of values"),
        ({"descr": [("a", "|O")]}, "Object arrays cannot be loaded"),
    ],
)
def test_a_header_that_claims_something_else_is_refused(tmp_path, header, message):
    path = archive(tmp_path / "a.npz", a=npy(np.zeros(10), **header))
    with pytest.raises(ValueError, match=f"not a readable .npz: .*{message}") as caught:
        read_arrays(path)
    assert "\n" not in str(caught.value)


def test_an_archive_that_unpacks_to_far_more_is_refused(tmp_path, monkeypatch):
    monkeypatch.setattr(size_guard, "ALWAYS_ALLOWED", 1 << 16)
    large = np.random.default_rng(0).normal(size=100_000)
    assert read_arrays(archive(tmp_path / "a.npz", a=npy(large)))["a"].nbytes == 800_000
    path = archive(tmp_path / "b.npz", a=npy(np.zeros(100_000)))
    with pytest.raises(ValueError, match=r"bytes that claim to hold 8001.., expected at most"):
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
