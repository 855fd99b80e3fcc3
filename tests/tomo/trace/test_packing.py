"""Crossings packed eight at a time are those that a loop over the pieces keeps."""

import numba
import numpy as np
import pytest

from tomo._compute.simd import LANES
from tomo.trace._packing import PIECES, ROOM, pack_numbered, pack_own, picks_lanes


@numba.njit
def picks():
    return picks_lanes()


@numba.njit
def packed(layers, pieces, number, at, voxel, length):
    if len(number) > 0:
        return pack_numbered(layers, pieces, number, at, voxel, length)
    return pack_own(layers, pieces, number, at, voxel, length)


def kept_one_by_one(layers, pieces, number):
    """Return the numbers and lengths that count, layer by layer."""
    found = pieces[: PIECES * LANES].reshape(PIECES, LANES)
    voxel = pieces[PIECES * LANES : 2 * PIECES * LANES].reshape(PIECES, LANES).astype(np.int64)
    kept = []
    for layer in range(layers):
        for piece in range(PIECES):
            if found[piece, layer] > 0:
                own = voxel[piece, layer]
                own = number[own] if len(number) else own
                if own >= 0:
                    kept.append((own, found[piece, layer]))
    return kept


@pytest.mark.skipif(not picks(), reason="needs AVX-512: other processors do not pack so")
@pytest.mark.parametrize("layers", [1, 5, LANES])
@pytest.mark.parametrize(
    ("whole", "real"), [(np.int32, np.float32), (np.int32, np.float64), (np.int64, np.float64)]
)
@pytest.mark.parametrize("numbered", [True, False])
def test_pieces_are_packed_as_one_by_one(layers, whole, real, numbered):
    random = np.random.default_rng(layers)
    for share in (0.0, 0.5, 1.0):
        pieces = np.zeros(2 * PIECES * LANES)
        lengths, places = pieces[: PIECES * LANES], pieces[PIECES * LANES :]
        lengths[:] = np.where(random.random(len(lengths)) < share, random.random(len(lengths)), 0)
        places[:] = random.integers(0, 90, len(places))
        places.reshape(PIECES, LANES)[:, layers:] = 1e9  # beyond the grid: not to be looked up
        number = np.where(random.random(90) < 0.6, np.arange(90), -1).astype(whole)
        number = number if numbered else number[:0]
        voxel, length = np.full(7 + ROOM, -7, whole), np.full(7 + ROOM, -7, real)
        end = packed(layers, pieces, number, np.uint64(7), voxel, length)
        expected = kept_one_by_one(layers, pieces, number)
        assert end == 7 + len(expected)
        assert (voxel[:7] == -7).all()
        assert (length[:7] == -7).all()
        assert [(v, x) for v, x in zip(voxel[7:end], length[7:end], strict=True)] == [
            (v, real(x)) for v, x in expected
        ]
