"""Inner products against exact sums, whatever the arrays are in memory."""

import math

import numpy as np
import pytest

from tomo._compute.reductions import dot, inner, largest, norm, total


def exact(a, b):
    return math.fsum(x * y for x, y in zip(a.ravel().tolist(), b.ravel().tolist(), strict=True))


@pytest.mark.parametrize("kinds", [("f4", "f4"), ("f8", "f8"), ("f4", "f8"), ("i4", "f4")])
@pytest.mark.parametrize("count", [0, 1, 7, 1000])
def test_it_is_the_exact_sum(kinds, count):
    random = np.random.default_rng(count)
    a, b = (100 * random.standard_normal(count).astype(kind) for kind in kinds)
    size = exact(np.abs(a), np.abs(b))
    assert dot(a, b) == pytest.approx(exact(a, b), abs=1e-14 * size)
    assert norm(a) == pytest.approx(math.sqrt(exact(a, a)), rel=1e-14)


def test_order_in_memory_and_leave_to_write_do_not_matter():
    a = np.random.default_rng(0).standard_normal((6, 10)).astype(np.float32)
    expected = dot(a, a + 1)
    apart = np.zeros((6, 20), np.float32)[:, ::2]
    apart[:] = a
    assert dot(apart, a + 1) == dot(np.asfortranarray(a), a + 1) == expected
    a.flags.writeable = False
    assert dot(a, a + 1) == expected


def test_squares_of_single_precision_neither_overflow_nor_vanish():
    for size in (1e30, 1e-30):
        assert norm(np.full(9, size, np.float32)) == pytest.approx(3 * size, rel=1e-6)
    assert math.isnan(norm(np.array([1.0, np.nan])))
    assert norm(np.array([1.0, -np.inf])) == math.inf


def test_other_shapes_are_refused():
    with pytest.raises(ValueError, match=r"inner product: found shapes \(3,\) and \(1, 3\)"):
        dot(np.ones(3), np.ones((1, 3)))


@pytest.mark.parametrize("count", [0, 1, 7, 1000, 4097])
def test_on_a_device_sums_are_exact_and_the_same_bits_by_every_library(count):
    pytest.importorskip("array_api_compat")
    libraries = [pytest.importorskip(name) for name in ("torch", "array_api_strict")]
    random = np.random.default_rng(count)
    a, b = (random.standard_normal((count, 2)).astype(np.float32) for _ in range(2))
    found = []
    for library in libraries:
        x, y = library.asarray(a.copy()), library.asarray(b.copy())
        found.append([*inner(x, y), dot(x, y), norm(x), *total(x), *largest(x)])
        assert inner(x[:, 0], y[:, 0]) == inner(x, y)[0]
        assert total(x[:, 1]) == total(x)[1]
    assert found[0] == found[1]
    exactly = [exact(*pair) for pair in ((a[:, 0], b[:, 0]), (a[:, 1], b[:, 1]), (a, b))]
    assert found[0][:3] == pytest.approx(exactly, abs=1e-14 * max(count, 1))
    assert found[0][3:] == pytest.approx([norm(a), *total(a), *largest(a)], rel=1e-12, abs=1e-12)
