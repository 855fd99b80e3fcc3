"""Segments packed one behind the other are those that have a length and a number."""

import numpy as np
import pytest

from tomo._compute.jit import compiled
from tomo.trace.march import SLABS, pack

PIECES = 3  # of a ray in a slab, at most


@compiled()
def packed(slabs, is_end, cuts, number, at, voxel, length):
    return pack(slabs, is_end, cuts, number, at, voxel, length)


def kept_one_by_one(slabs, cuts, number):
    """Return the numbers and lengths that count, slab by slab."""
    found = cuts[: PIECES * SLABS].reshape(PIECES, SLABS)
    voxel = cuts[PIECES * SLABS : 2 * PIECES * SLABS].reshape(PIECES, SLABS).astype(np.int64)
    kept = []
    for slab in range(slabs):
        for part in range(PIECES):
            if found[part, slab] > 0:
                own = voxel[part, slab]
                own = number[own] if len(number) else own
                if own >= 0:
                    kept.append((own, found[part, slab]))
    return kept


@pytest.mark.parametrize("slabs", [1, 5, SLABS])
@pytest.mark.parametrize(
    ("whole", "real"), [(np.int32, np.float32), (np.int32, np.float64), (np.int64, np.float64)]
)
@pytest.mark.parametrize("numbered", [True, False])
def test_segments_are_packed_in_order_and_without_gaps(slabs, whole, real, numbered):
    random = np.random.default_rng(slabs)
    for fraction in (0.0, 0.5, 1.0):
        cuts = np.zeros(2 * PIECES * SLABS)
        lengths, voxels = cuts[: PIECES * SLABS], cuts[PIECES * SLABS :]
        lengths[:] = np.where(
            random.random(len(lengths)) < fraction, random.random(len(lengths)), 0
        )
        voxels[:] = random.integers(0, 90, len(voxels))
        voxels.reshape(PIECES, SLABS)[:, slabs:] = 1e9  # beyond the grid: not to be looked up
        number = np.where(random.random(90) < 0.6, np.arange(90), -1).astype(whole)
        number = number if numbered else number[:0]
        lengths[slabs - 1] = 0.5  # a ray has a segment in each slab that it passes
        most = len(kept_one_by_one(slabs, cuts, number[:0]))
        expected = kept_one_by_one(slabs, cuts, number)
        for is_end in (False, True):
            room = 7 + most + (not is_end)  # an end writes nothing behind the last
            voxel, length = np.full(room, -7, whole), np.full(room, -7, real)
            end = packed(slabs, is_end, cuts, number, np.uint64(7), voxel, length)
            assert end == 7 + len(expected)
            assert (voxel[:7] == -7).all()
            assert (length[:7] == -7).all()
            assert [(v, x) for v, x in zip(voxel[7:end], length[7:end], strict=True)] == [
                (v, real(x)) for v, x in expected
            ]
