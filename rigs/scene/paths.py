"""Lines of sight through a scene: straight pieces, one behind the other."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rigs.scene.gas import IndexField
from rigs.scene.mesh import Mesh
from rigs.scene.tracing import TRAPPED, Pieces, Rays, follow, numbers_of, write_pieces

MOST_FACES = 50
"""Faces that a ray may meet: two mirrors that face each other would reflect it for ever."""

EVERYWHERE = np.array([[-np.inf] * 3, [np.inf] * 3])
"""A region that leaves no piece out."""

AT_ONCE = 8192
"""Rays that are followed together: their arrays then stay in a processor's cache."""


@dataclass(frozen=True, eq=False)
class Paths:
    """Rays as straight pieces; ray ``r`` owns the pieces ``ray_ptr[r]:ray_ptr[r + 1]``.

    Attributes
    ----------
    origins, directions, lengths : (N, 3), (N, 3), (N,) float64
        Of each piece, in world coordinates; infinite for the last of a ray that nothing ends.
    weight : (N,) float64
        Fraction of the light emitted on the piece that reaches the camera.
    solids : (N,) int64
        Number of the solid that each piece ends at, -1 where nothing is ahead.
    ray_ptr : (rays + 1,) int64
    ends : (rays,) int64
        How each ray ends, as in `rigs.scene.tracing`.
    """

    origins: NDArray[np.float64]
    directions: NDArray[np.float64]
    lengths: NDArray[np.float64]
    weight: NDArray[np.float64]
    solids: NDArray[np.int64]
    ray_ptr: NDArray[np.int64]
    ends: NDArray[np.int64]

    def __len__(self) -> int:
        """Return the number of rays."""
        return len(self.ends)

    def __repr__(self) -> str:
        """Name the sizes."""
        return f"<Paths: {len(self)} rays, {len(self.lengths)} pieces>"

    def nearest_pieces(self, points: NDArray[np.float64]) -> NDArray[np.int64]:
        """Return the number of each ray's first piece that passes its point most closely."""
        counts = np.diff(self.ray_ptr)
        if not counts.all():
            raise ValueError("paths: found rays without pieces, expected whole paths")
        away = np.broadcast_to(points, (len(self), 3)).repeat(counts, axis=0) - self.origins
        along = np.clip(np.einsum("ij,ij->i", away, self.directions), 0, self.lengths)
        missed = np.linalg.norm(away - along[:, None] * self.directions, axis=1)
        least = np.minimum.reduceat(missed, self.ray_ptr[:-1]) if len(missed) else missed
        is_least = missed == np.repeat(least, counts)
        first = np.maximum.accumulate(np.where(is_least[::-1], np.arange(len(missed)), -1))[::-1]
        return (len(missed) - 1 - first)[self.ray_ptr[:-1]]


def trace_paths(
    faces: NDArray,
    meshes: list[tuple[int, Mesh]],
    medium: float,
    origins: NDArray[np.float64],
    directions: NDArray[np.float64],
    *,
    fresnel: bool = False,
    region: NDArray[np.float64] = EVERYWHERE,
    gas: IndexField | None = None,
) -> Paths:
    """Return the paths of rays ``(N, 3)`` in a ``medium`` of that index, all at once.

    ``faces`` are rows of `rigs.scene.surfaces.FACE`; each mesh comes with its row's number. See
    `rigs.scene.Scene` for the others; the gas's box holds no solid, and its pieces are all kept.
    """
    bounds = [mesh.box for _, mesh in meshes] + (
        [] if gas is None else [np.stack([gas.lower, gas.upper])]
    )
    boxes = np.array(bounds).reshape(-1, 2, 3)
    numbers = numbers_of(faces)
    pieces = _pieces(MOST_FACES + 1, min(AT_ONCE, len(origins)))
    counts, ends = np.zeros(len(origins), np.int64), np.zeros(len(origins), np.int64)
    columns, total = _pieces(0), 0
    for first in range(0, len(origins), AT_ONCE):
        some = slice(first, first + AT_ONCE)
        rays = _rays(origins[some], directions[some], medium)
        pieces = _follow_to_ends(rays, pieces, numbers, meshes, boxes, region, fresnel, gas)
        counts[some], ends[some] = rays.pieces, rays.end
        starts = total + np.cumsum(rays.pieces) - rays.pieces
        total += int(rays.pieces.sum())
        if total > len(columns.lengths):
            wanted = total * len(origins) // (first + len(rays.end))
            columns = _longer(columns, wanted + wanted // 16)
        write_pieces(rays.pieces, starts, pieces, columns)
    ray_ptr = np.concatenate([np.zeros(1, np.int64), np.cumsum(counts)])
    return Paths(*Pieces(*(column[:total] for column in columns)), ray_ptr, ends)


def _rays(origins: NDArray[np.float64], directions: NDArray[np.float64], medium: float) -> Rays:
    """Return rays that set out in a medium."""
    n = len(origins)
    zeros, whole = np.zeros(n), np.zeros(n, np.int64)
    return Rays(
        origin=origins.copy(), direction=directions.copy(), index=zeros + medium,
        extinction=zeros.copy(), weight=zeros + 1, last=whole - 1, asked=np.zeros(n, bool),
        face=whole.copy(), length=zeros, normal=np.zeros((n, 3)), met=whole.copy(),
        pieces=whole.copy(), end=whole,
    )  # fmt: skip


def _pieces(*shape: int) -> Pieces:
    """Return columns of zeros for pieces of that shape."""
    vectors = (np.zeros((*shape, 3)), np.zeros((*shape, 3)))
    return Pieces(*vectors, np.zeros(shape), np.zeros(shape), np.zeros(shape, np.int64))


def _follow_to_ends(
    rays: Rays,
    pieces: Pieces,
    faces: tuple[NDArray, NDArray],
    meshes: list[tuple[int, Mesh]],
    boxes: NDArray[np.float64],
    region: NDArray[np.float64],
    fresnel: bool,
    gas: IndexField | None,
) -> Pieces:
    """Follow rays to their ends; return their pieces, in a longer array where gas has many."""
    active, waiting = np.arange(len(rays.end)), np.zeros(len(rays.end), np.int64)
    while True:
        count = follow(
            active, rays, pieces, *faces, boxes, region, MOST_FACES + 1, fresnel, waiting
        )
        if not count:
            return pieces
        active = waiting[:count].copy()
        origin, direction, last = rays.origin[active], rays.direction[active], rays.last[active]
        for row, mesh in meshes:
            met, distance, normal = mesh.nearest(
                origin, direction, last == row, rays.length[active]
            )
            rays.length[active[met]], rays.normal[active[met]] = distance, normal
            rays.face[active[met]] = row
        rays.asked[active] = True
        if gas is not None:
            pieces = through_gas(gas, rays, pieces, active, room=MOST_FACES + 1)


def through_gas(
    gas: IndexField, rays: Rays, pieces: Pieces, active: NDArray[np.int64], room: int
) -> Pieces:
    """Take rays that come to gas before the next face through it; return the pieces.

    ``active`` ``(K,)`` are rays whose next face is known. ``pieces`` ``(rows, N)`` take those to
    the gas and in it, and grow if they have to; ``room`` rows stay free behind the last.
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
    longer = _pieces(rows, *pieces.lengths.shape[1:])
    for new, old in zip(longer, pieces, strict=True):
        new[: len(old)] = old
    return longer
