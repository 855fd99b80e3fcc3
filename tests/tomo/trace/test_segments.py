import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tomo.trace import Segments


def make(counts, seed=0, midpoint=True):
    rng = np.random.default_rng(seed)
    ptr = np.concatenate([[0], np.cumsum(counts)]).astype(np.int64)
    n = int(ptr[-1])
    return Segments(
        ptr,
        rng.integers(0, 50, n).astype(np.int32),
        rng.random(n).astype(np.float32),
        rng.random((n, 3)).astype(np.float32) if midpoint else None,
    )


def pixels(segments):
    """Return the entries of every pixel: the readable form that all else is compared with."""
    middle = segments.midpoint
    return [
        [
            (int(segments.voxel[s]), float(segments.length[s]))
            + (() if middle is None else tuple(middle[s].tolist()))
            for s in range(segments.ptr[p], segments.ptr[p + 1])
        ]
        for p in range(segments.n_pixels)
    ]


counts = st.lists(st.integers(0, 4), max_size=12)
seeds = st.integers(0, 1000)


@given(counts, seeds, st.booleans(), st.data())
def test_rows_are_the_pixels_asked_for_and_share_the_entries(counts, seed, midpoint, data):
    segments = make(counts, seed, midpoint)
    start = data.draw(st.integers(0, len(counts)))
    stop = data.draw(st.integers(start, len(counts)))
    rows = segments.rows(start, stop)
    assert pixels(rows) == pixels(segments)[start:stop]
    assert len(rows) == 0 or np.shares_memory(rows.length, segments.length)


@given(counts, seeds, st.booleans(), st.data())
def test_take_gives_any_pixels_in_any_order(counts, seed, midpoint, data):
    segments = make(counts, seed, midpoint)
    number = st.integers(0, len(counts) - 1)
    chosen = data.draw(st.lists(number, max_size=9)) if counts else []
    taken = segments.take(np.array(chosen, np.int64))
    assert pixels(taken) == [pixels(segments)[p] for p in chosen]
    assert (taken.midpoint is None) == (not midpoint)
    assert not np.shares_memory(taken.length, segments.length)


@given(counts, seeds, st.booleans(), st.data())
def test_between_gives_pixels_from_where_their_entries_start_and_stop(
    counts, seed, midpoint, data
):
    segments = make(counts, seed, midpoint)
    spans = data.draw(
        st.lists(
            st.tuples(*[st.integers(0, len(segments))] * 2).map(sorted), min_size=0, max_size=5
        )
    )
    starts, stops = np.array(spans, np.int64).reshape(-1, 2).T
    entries = [e for pixel in pixels(segments) for e in pixel]
    assert pixels(segments.between(starts, stops)) == [entries[a:b] for a, b in spans]
    whole = segments.between(segments.ptr[:-1], segments.ptr[1:])
    assert pixels(whole) == pixels(segments)
    assert len(segments) == 0 or np.shares_memory(whole.length, segments.length)


@given(counts, seeds, st.booleans())
def test_without_empty_drops_the_pixels_that_cross_nothing(counts, seed, midpoint):
    segments = make(counts, seed, midpoint)
    full, kept = segments.without_empty()
    assert kept.tolist() == [p for p, n in enumerate(counts) if n > 0]
    assert pixels(full) == [pixels(segments)[p] for p in kept]
    assert len(full) == len(segments)


@given(st.lists(counts, min_size=1, max_size=4), seeds, st.booleans())
def test_concatenate_puts_parts_one_after_another(parts, seed, midpoint):
    parts = [make(counts, seed + i, midpoint) for i, counts in enumerate(parts)]
    whole = Segments.concatenate(parts)
    assert pixels(whole) == [row for part in parts for row in pixels(part)]
    bounds = np.cumsum([0] + [part.n_pixels for part in parts])
    for part, start, stop in zip(parts, bounds[:-1], bounds[1:], strict=True):
        assert pixels(whole.rows(start, stop)) == pixels(part)


def test_concatenate_drops_midpoints_that_not_all_parts_have():
    whole = Segments.concatenate([make([2, 1]), make([1], midpoint=False)])
    assert whole.midpoint is None
    assert len(whole) == 4


def test_concatenate_keeps_the_wider_type():
    narrow, wide = make([2]), make([1])
    wide = Segments(wide.ptr, wide.voxel.astype(np.int64) + 2**40, wide.length, wide.midpoint)
    assert Segments.concatenate([narrow, wide]).voxel.tolist() == [
        *narrow.voxel.tolist(),
        *wide.voxel.tolist(),
    ]


def test_sizes():
    segments = make([2, 0, 3])
    assert (len(segments), segments.n_pixels) == (5, 3)
    assert segments.nbytes == 4 * 8 + 5 * (4 + 4 + 12)
    assert "3 pixels, 5 segments" in repr(segments)


@pytest.mark.parametrize(
    ("parts", "message"),
    [
        ((np.array([0, 2], np.int32), np.zeros(2, int), np.zeros(2)), "ptr: expected an int64"),
        ((np.array([1, 2]), np.zeros(2, int), np.zeros(2)), "ptr: expected an int64"),
        ((np.array([0, 2]), np.zeros(3, int), np.zeros(2)), "voxel: found shape"),
        ((np.array([0, 2]), np.zeros(2, int), np.zeros(1)), "length: found shape"),
        ((np.array([0, 2]), np.zeros(2, int), np.zeros(2), np.zeros((2, 2))), "midpoint: found"),
    ],
)
def test_parts_that_do_not_belong_together_are_refused(parts, message):
    with pytest.raises(ValueError, match=message):
        Segments(*parts)


def test_nothing_to_concatenate_is_refused():
    with pytest.raises(ValueError, match="expected at least one"):
        Segments.concatenate([])
