"""What becomes of rays in gas: straight pieces, and where and how each ray goes on."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rigs.scene.gas.spline_steps import CHORD


@dataclass(frozen=True, eq=False)
class Crossing:
    """The ways of rays through a box of gas; ray ``r`` owns the pieces ``ptr[r]:ptr[r + 1]``.

    Attributes
    ----------
    origins, directions : (P, 3) float64
        Where each piece begins, and its unit vector. The first piece of a ray begins where the
        ray enters the box, or where it starts inside.
    lengths : (P,) float64
    ptr : (rays + 1,) int64
        A ray that misses the box has no piece.
    exit_origins, exit_directions : (rays, 3) float64
        Where a ray leaves the box, and the unit vector along which it goes on; those it came with
        where it misses the box.
    trapped : (rays,) bool
        Whether a ray was given up inside, after more steps than any way through takes.
    """

    origins: NDArray[np.float64]
    directions: NDArray[np.float64]
    lengths: NDArray[np.float64]
    ptr: NDArray[np.int64]
    exit_origins: NDArray[np.float64]
    exit_directions: NDArray[np.float64]
    trapped: NDArray[np.bool_]

    def __len__(self) -> int:
        """Return the number of pieces."""
        return len(self.lengths)

    def __repr__(self) -> str:
        """Name the sizes."""
        return f"<Crossing: {len(self.ptr) - 1} rays, {len(self)} pieces>"


def pairs_of_vectors(
    origins: ArrayLike, directions: ArrayLike
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return origins and unit directions of rays, ``(rays, 3)`` each.

    Raises
    ------
    ValueError
        If the shapes differ, or a number is not finite or a direction is zero.
    """
    origins, directions = (
        np.ascontiguousarray(np.atleast_2d(np.asarray(one, np.float64)))
        for one in (origins, directions)
    )
    if origins.shape != directions.shape or origins.shape[1:] != (3,):
        raise ValueError(
            f"rays: found origins {origins.shape} and directions {directions.shape}, expected "
            "(rays, 3) twice"
        )
    norms = np.linalg.norm(directions, axis=1, keepdims=True)
    if not (np.isfinite(origins).all() and np.isfinite(norms).all() and (norms > 0).all()):
        raise ValueError("rays: found NaN, infinity or a zero direction, expected finite rays")
    return origins, directions / norms


def chords(
    nodes: NDArray[np.float64], tangents: NDArray[np.float64], tolerance: float
) -> NDArray[np.int64]:
    """Return the numbers of the nodes at which pieces of a path end, both ends included.

    Parameters
    ----------
    nodes, tangents : (N, 3) float64
        Points along the path and its unit vectors there.
    tolerance : float
        How far the path may be from a piece.

    Notes
    -----
    A path of length ``S`` whose direction turns by ``a`` altogether is nowhere farther than
    ``S a / 4`` from the chord of its ends (`rigs.scene.gas.spline_steps`).
    """
    ends, length, turn = [0], 0.0, 0.0
    steps = np.linalg.norm(np.diff(nodes, axis=0), axis=1)
    turns = np.linalg.norm(np.diff(tangents, axis=0), axis=1)
    for node, (step, angle) in enumerate(zip(steps, turns, strict=True)):
        if length > 0 and CHORD * (length + step) * (turn + angle) > tolerance:
            ends.append(node)
            length = turn = 0.0
        length, turn = length + step, turn + angle
    return np.array([*ends, len(steps)])
