"""Rays of a scene that come to gas: the pieces in it, and how they go on."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from rigs.scene.gas import IndexField
from rigs.scene.tracing import TRAPPED, Pieces, Rays


def gas_box(gas: IndexField) -> NDArray[np.float64]:
    """Return the lower and upper corner of the gas's box, ``(2, 3)``."""
    return np.stack([gas.lower, gas.upper])


def through_gas(
    gas: IndexField, rays: Rays, pieces: Pieces, active: NDArray[np.int64], room: int
) -> Pieces:
    """Take rays that come to gas before the next face through it.

    Parameters
    ----------
    gas : IndexField
    rays : Rays
        Changed in place: those that pass gas go on from where they leave it.
    pieces : Pieces, of arrays (rows, N) and (rows, N, 3)
        Written: the piece up to the gas, and those in it.
    active : (K,) int64
        Rays whose next face is known.
    room : int
        Rows that have to stay free behind the last piece.

    Returns
    -------
    Pieces
        Those given, or longer ones.
    """
    ahead = gas.ahead(rays.origin[active], rays.direction[active])
    come = ahead < rays.length[active]
    numbers, ahead = active[come], ahead[come]
    if not len(numbers):
        return pieces
    origins, directions = rays.origin[numbers].copy(), rays.direction[numbers].copy()
    found = gas.cross(origins, directions)
    counts = np.diff(found.ptr)
    first = rays.pieces[numbers]
    wanted = int((first + counts).max()) + 1 + room
    if wanted > len(pieces.lengths):
        pieces = _longer(pieces, wanted)
    _write(pieces, first, numbers, origins, directions, ahead, rays.weight[numbers])
    for step in range(int(counts.max())):
        some = np.flatnonzero(counts > step)
        piece, ray = found.ptr[some] + step, numbers[some]
        vectors = found.origins[piece], found.directions[piece]
        _write(
            pieces, first[some] + 1 + step, ray, *vectors, found.lengths[piece], rays.weight[ray]
        )
    rays.pieces[numbers] += 1 + counts
    rays.origin[numbers], rays.direction[numbers] = found.exit_origins, found.exit_directions
    rays.last[numbers] = -1  # the way back may meet the face that the ray came from
    rays.asked[numbers] = False
    rays.end[numbers[found.trapped]] = TRAPPED
    return pieces


def _write(
    pieces: Pieces,
    row: NDArray[np.int64],
    ray: NDArray[np.int64],
    origins: NDArray[np.float64],
    directions: NDArray[np.float64],
    lengths: NDArray[np.float64],
    weight: NDArray[np.float64],
) -> None:
    """Write a piece of each ray; none of them ends at a solid."""
    pieces.origins[row, ray], pieces.directions[row, ray] = origins, directions
    pieces.lengths[row, ray], pieces.weight[row, ray] = lengths, weight
    pieces.solids[row, ray] = -1


def _longer(pieces: Pieces, rows: int) -> Pieces:
    """Return pieces with that many rows, which begin with those given."""
    longer = []
    for column in pieces:
        new = np.zeros((rows, *column.shape[1:]), column.dtype)
        new[: len(column)] = column
        longer.append(new)
    return Pieces(*longer)
