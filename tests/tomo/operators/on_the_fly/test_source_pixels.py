"""Pixels counted over all sources, and by each of them."""

import itertools

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from tomo.operators.on_the_fly.source_pixels import pixels_between, pixels_by_source

COUNTS = st.lists(st.integers(0, 4), min_size=1, max_size=6)


def numbered(counts):
    """Return where sources begin, and of every pixel its source and number there."""
    ptr = np.cumsum([0, *counts])
    return ptr, [(source, own) for source, count in enumerate(counts) for own in range(count)]


@given(COUNTS, st.data())
def test_a_stretch_of_pixels(counts, data):
    ptr, expected = numbered(counts)
    start = data.draw(st.integers(0, len(expected)))
    stop = data.draw(st.integers(start, len(expected)))
    found = pixels_between(ptr, start, stop)
    assert [(n, own) for n, s in found for own in range(s.start, s.stop)] == expected[start:stop]


@given(COUNTS, st.data())
def test_any_pixels_in_any_order(counts, data):
    ptr, expected = numbered(counts)
    pixel = st.integers(0, max(len(expected) - 1, 0))
    pixels = np.array(data.draw(st.lists(pixel)) if expected else [], np.int64)
    found = pixels_by_source(ptr, pixels)
    assert [(n, own) for n, some in found for own in some.tolist()] == [
        expected[number] for number in pixels
    ]
    assert all(a[0] != b[0] for a, b in itertools.pairwise(found))
