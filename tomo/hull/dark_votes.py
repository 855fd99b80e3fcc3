"""The voxels that views prove dark, and the pixels that a set of voxels can explain.

A voxel's image is bounded by the box of pixels that its projected edges span; the
summed-area table of the bright pixels answers in four look-ups whether the box is dark
(Crow, "Summed-area tables for texture mapping", SIGGRAPH 1984). Whole bricks are tested first.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Sequence

import numpy as np
from numpy.typing import NDArray

from tomo.hull import _kernels as kernels
from tomo.hull.projection_lattice import STEP, Lattice, bricks_of

Shapes = Sequence[tuple[int, int]]


def dark_votes(
    bright: Sequence[NDArray[np.bool_]],
    lattices: Sequence[Lattice],
    shape: tuple[int, int, int],
    *,
    margin: float,
    enough: int,
    beyond: bool = False,
) -> NDArray[np.uint8]:
    """Return how many views prove each voxel dark, counted up to ``enough`` (to 255): ``shape``.

    A box of a voxel, grown by ``margin`` pixels on every side, is dark where no pixel in it is
    ``bright``, or unusable. If ``beyond``, what lies beyond an image is as dark as the nearest
    pixel of its border; else a box that leaves the image is not dark.
    """
    votes = np.zeros(shape, np.uint8)
    reach = np.array([margin + lattice.slack for lattice in lattices])
    corners = np.stack([lattice.corners for lattice in lattices])
    layout = _layout([image.shape for image in bright])
    tables = np.zeros(int(layout[-1, 0]), np.int32)
    for image, table in zip(bright, _tables(tables, layout), strict=True):
        table[1:, 1:] = image
    kernels.sum_up(tables, layout)
    kernels.vote(tables, layout, corners, reach, enough, beyond, votes)
    return votes


def touched(
    active: NDArray[np.bool_], lattices: Sequence[Lattice], image_shapes: Shapes
) -> list[NDArray[np.bool_]]:
    """Return for each view the pixels that the active voxels' boxes touch: its ``image_shape``.

    All pixels where the camera does not see every brick.
    """
    layout = _layout(image_shapes)
    steps = np.zeros(int(layout[-1, 0]), np.int32)
    slack = np.array([lattice.slack for lattice in lattices])
    corners = np.stack([one.corners for one in lattices])
    kernels.splat(corners, *_by_brick(surface(active)), slack, layout, steps)
    kernels.sum_up(steps, layout)
    found = []
    for lattice, counts in zip(lattices, _tables(steps, layout), strict=True):
        seen = counts[:-1, :-1] > 0
        if active.any() and not np.isfinite(lattice.corners).all():
            seen[:] = True
        found.append(seen)
    return found


def surface(active: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Return the active voxels with an inactive neighbour: only these show from outside."""
    inner = active.copy()
    for axis in range(3):
        along = np.moveaxis(active, axis, 0)
        kept = np.moveaxis(inner, axis, 0)
        kept[1:] &= along[:-1]
        kept[:-1] &= along[1:]
        kept[[0, -1]] = False
    return active & ~inner


def _by_brick(
    active: NDArray[np.bool_],
) -> tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.float64]]:
    """Return the bricks with an active voxel (B, 3), and where in each the active voxels are.

    Brick ``b`` has the voxels ``ptr[b]:ptr[b + 1]``, their middles from 0 to 1 across it: (V, 3).
    """
    shape = bricks_of(active.shape)
    padded = np.pad(active, [(0, STEP * b - n) for b, n in zip(shape, active.shape, strict=True)])
    cells = padded.reshape(*(size for b in shape for size in (b, STEP)))
    inside = cells.transpose(0, 2, 4, 1, 3, 5).reshape(-1, STEP**3)
    counts = np.count_nonzero(inside, axis=1)
    found = np.flatnonzero(counts)
    position = np.stack(np.unravel_index(np.flatnonzero(inside) % STEP**3, (STEP,) * 3), axis=1)
    ptr = np.concatenate([[0], np.cumsum(counts[found])])
    return np.stack(np.unravel_index(found, shape), axis=1), ptr, (position + 0.5) / STEP


def _layout(image_shapes: Shapes) -> NDArray[np.int64]:
    """Return ``(views + 1, 3)``: where each view's table begins in one vector, height, width."""
    layout = np.zeros((len(image_shapes) + 1, 3), np.int64)
    layout[:-1, 1:] = np.reshape(image_shapes, (-1, 2))
    layout[1:, 0] = np.cumsum(np.prod(layout[:-1, 1:] + 1, axis=1))
    return layout


def _tables(values: NDArray[np.int32], layout: NDArray[np.int64]) -> Iterator[NDArray[np.int32]]:
    """Go through the views' tables, ``(height + 1, width + 1)`` each."""
    for (start, height, width), (stop, _, _) in itertools.pairwise(layout):
        yield values[start:stop].reshape(height + 1, width + 1)
