"""Compressed streams: their claims, against their content."""

import bz2
import gzip
import zlib

import numpy as np
import pytest

from rigs.files.size_guard import (
    ALWAYS_ALLOWED,
    check_claim,
    decompressed,
    errors_of_libraries,
    largest_claim,
)

PACKERS = [(zlib.compress, "zlib"), (gzip.compress, "zlib"), (bz2.compress, "bzip2")]


@pytest.mark.parametrize(("pack", "method"), PACKERS)
def test_a_stream_gives_no_more_than_is_expected(pack, method):
    data = bytes(range(256)) * 10
    for most in (len(data), len(data) + 1):
        assert decompressed(pack(data), most, method) == data
    for most in (0, 1, len(data) - 1):
        with pytest.raises(ValueError, match=f"compressed values of more than {most} bytes"):
            decompressed(pack(data), most, method)
    with pytest.raises(ValueError, match="claim to hold"):
        decompressed(pack(data), 10**10, method)


@pytest.mark.parametrize(("pack", "method"), PACKERS)
@pytest.mark.parametrize("count", [-1, -2, -(10**9)])
def test_a_negative_claim_is_refused_before_anything_is_unpacked(pack, method, count):
    """A negative limit is no limit to the libraries."""
    with pytest.raises(ValueError, match=f"found a claim of {count} bytes, expected 0 or more"):
        decompressed(pack(bytes(1000)), count, method)


@pytest.mark.parametrize("lost", [1, 4, 8])
@pytest.mark.parametrize(("pack", "method"), PACKERS)
def test_a_stream_without_its_end_is_refused_though_all_values_are_there(pack, method, lost):
    """The check sum at the end shows whether the values are right."""
    data = bytes(range(256)) * 10
    with pytest.raises(ValueError, match="truncated"):
        decompressed(pack(data)[:-lost], len(data), method)


def test_measured_fields_are_far_from_the_limit():
    smooth = np.exp(-(np.linspace(-2, 2, 60_000, dtype=np.float32) ** 2))
    stored = len(zlib.compress(smooth.tobytes()))
    assert smooth.nbytes < largest_claim(stored) - ALWAYS_ALLOWED
    check_claim(ALWAYS_ALLOWED, 0)
    with pytest.raises(ValueError, match="damaged, or has to be stored without compression"):
        check_claim(ALWAYS_ALLOWED + 1, 0)


@pytest.mark.parametrize("error", [OSError("two\nlines"), KeyError(), MemoryError()])
def test_any_error_of_a_library_becomes_one_line(error):
    def fail():
        with errors_of_libraries("a.tif: not readable"):
            raise error

    with pytest.raises(ValueError, match=r"^a\.tif: not readable: ") as caught:
        fail()
    reason = str(caught.value).removeprefix("a.tif: not readable: ")
    assert reason in ("two lines", "KeyError", "MemoryError")
