"""Segments packed one behind the other are those that have a length and a number."""

import numpy as np
import pytest

from tomo._compute.jit import compiled
from tomo.trace._packing import SLABS, pack

PIECES = 3  # of a ray in a slab, at most


@compiled()
def packed(layers, is_end, pieces, number, at, voxel, length):
    return pack(layers, is_end, pieces, number, at, voxel, length)


def kept_one_by_one(layers, pieces, number):
    """Return the numbers and lengths that count, slab by slab."""
    found = pieces[: PIECES * SLABS].reshape(PIECES, SLABS)
    voxel = pieces[PIECES * SLABS : 2 * PIECES * SLABS].reshape(PIECES, SLABS).astype(np.int64)
    kept = []
    for layer in range(layers):
        for piece in range(PIECES):
            if found[piece, layer] > 0:
                own = voxel[piece, layer]
                own = number[own] if len(number) else own
                if own >= 0:
                    kept.append((own, found[piece, layer]))
    return kept


@pytest.mark.parametrize("layers", [1, 5, SLABS])
@pytest.mark.parametrize(
    ("whole", "real"), [(np.int32, np.float32), (np.int32, np.float64), (np.int64, np.float64)]
)
@pytest.mark.parametrize("numbered", [True, False])
def test_segments_are_packed_in_order_and_without_gaps(layers, whole, real, numbered):
    random = np.random.default_rng(layers)
    for fraction in (0.0, 0.5, 1.0):
        pieces = np.zeros(2 * PIECES * SLABS)
        lengths, voxels = pieces[: PIECES * SLABS], pieces[PIECES * SLABS :]
        lengths[:] = np.where(
            random.random(len(lengths)) < fraction, random.random(len(lengths)), 0
        )
        voxels[:] = random.integers(0, 90, len(voxels))
        voxels.reshape(PIECES, SLABS)[:, layers:] = 1e9  # beyond the grid: not to be looked up
        number = np.where(random.random(90) < 0.6, np.arange(90), -1).astype(whole)
        number = number if numbered else number[:0]
        lengths[layers - 1] = 0.5  # a ray has a segment in each slab that it passes
        most = len(kept_one_by_one(layers, pieces, number[:0]))
        expected = kept_one_by_one(layers, pieces, number)
        for is_end in (False, True):
            room = 7 + most + (not is_end)  # an end writes nothing behind the last
            voxel, length = np.full(room, -7, whole), np.full(room, -7, real)
            end = packed(layers, is_end, pieces, number, np.uint64(7), voxel, length)
            assert end == 7 + len(expected)
            assert (voxel[:7] == -7).all()
            assert (length[:7] == -7).all()
            assert [(v, x) for v, x in zip(voxel[7:end], length[7:end], strict=True)] == [
                (v, real(x)) for v, x in expected
            ]
