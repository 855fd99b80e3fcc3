import itertools

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from rigs import ring
from tomo import VoxelGrid
from tomo.operators.on_the_fly.camera_sources import CameraPixels
from tomo.operators.on_the_fly.ray_sources import PixelRuns, pixels_between, pixels_by_source

COUNT = 60
CASES = {
    "none": [],
    "one": [7],
    "all": list(range(COUNT)),
    "a box": [row * 10 + column for row in range(1, 5) for column in range(3, 8)],
    "every other": list(range(0, COUNT, 2)),
    "not in order": [30, 31, 32, 5, 6, 59, 0, 0, 1],
}


@pytest.mark.parametrize("numbers", CASES.values(), ids=CASES.keys())
def test_runs_are_the_numbers_they_were_made_of(numbers):
    runs = PixelRuns.of(np.array(numbers, np.int64), COUNT)
    assert len(runs) == len(numbers)
    for start in range(len(numbers) + 1):
        for stop in range(start, len(numbers) + 1):
            assert runs.between(start, stop).tolist() == numbers[start:stop]


def test_all_of_an_image_is_one_run():
    runs = PixelRuns.all_of(COUNT)
    assert len(runs.first) == 1
    assert runs.between(0, COUNT).tolist() == list(range(COUNT))


def test_neighbours_take_no_room():
    box = np.add.outer(np.arange(100) * 1000, np.arange(200, 700)).ravel()
    runs = PixelRuns.of(box, 10**6)
    assert runs.first.nbytes + runs.ptr.nbytes < box.nbytes / 200


def test_numbers_beyond_32_bits():
    numbers = np.array([2**33, 2**33 + 1, 5])
    assert PixelRuns.of(numbers, 2**34).between(0, 3).tolist() == numbers.tolist()


@pytest.mark.parametrize("some", [slice(3, 40), np.array([2, 3, 4, 50, 51])])
def test_taken_pixels_have_the_rays_of_those_taken(some):
    camera = ring(1, distance=50.0, image_size=(10, 6), footprint=1.0)[0]
    grid = VoxelGrid((8, 8, 8), 1.0)
    every = CameraPixels.of(camera)
    taken = every.take(slice(5, 60)).take(some)
    numbers = np.arange(5, 60)[some]
    for axes in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):
        mine, whole = np.zeros((len(numbers), 8)), np.zeros((60, 8))
        taken.writer(grid, axes)(0, len(numbers), mine)
        every.writer(grid, axes)(0, 60, whole)
        assert np.array_equal(mine, whole[numbers])


SOURCE_SIZES = st.lists(st.integers(0, 4), min_size=1, max_size=6)


def numbered(counts):
    """Return where sources begin, and of every pixel its source and number there."""
    ptr = np.cumsum([0, *counts])
    return ptr, [(source, own) for source, count in enumerate(counts) for own in range(count)]


@given(SOURCE_SIZES, st.data())
def test_a_stretch_of_pixels(counts, data):
    ptr, expected = numbered(counts)
    start = data.draw(st.integers(0, len(expected)))
    stop = data.draw(st.integers(start, len(expected)))
    found = pixels_between(ptr, start, stop)
    assert [(n, own) for n, s in found for own in range(s.start, s.stop)] == expected[start:stop]


@given(SOURCE_SIZES, st.data())
def test_any_pixels_in_any_order(counts, data):
    ptr, expected = numbered(counts)
    pixel = st.integers(0, max(len(expected) - 1, 0))
    pixels = np.array(data.draw(st.lists(pixel)) if expected else [], np.int64)
    found = pixels_by_source(ptr, pixels)
    assert [(n, own) for n, some in found for own in some.tolist()] == [
        expected[number] for number in pixels
    ]
    assert all(a[0] != b[0] for a, b in itertools.pairwise(found))
