"""A frame's volume from its own solution and its neighbours': noise differs, emission is alike."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from tomo._compute.reductions import norm
from tomo.grid import ActiveVoxels
from tomo.grid.blur import Blur
from tomo.pipeline.build import WeightedSystem

REACH = 2
"""Neighbours on either side. Each one more costs two solves a block; a third gained 0.5 % more."""

SPLIT = 1.2
"""Standard deviation of the blur that parts coarse from fine structures, in voxels. Fine ones are
noisier and change faster: about the size of the smallest that views resolve."""

LEAST_MOVE = 0.05
"""Voxels below which a motion is none: interpolation would cost more than it gains."""


@dataclass(frozen=True)
class TemporalFilter:
    """Weights of neighbouring frames, for coarse and for fine structures.

    Notes
    -----
    ``y_t = max(0, Σ_k [a_|k| B + b_|k| (1 - B)] M_k x_(t+k))`` with the solutions ``x``, the blur
    ``B`` of `SPLIT` and ``M_k``, which moves a volume back by ``k`` frames of ``velocity``. With
    weights from left-out pixels it is an empirical Wiener filter in time. A frame whose
    own residual would grow more than ``most`` times is unlike its neighbours: it stays as it is.
    """

    coarse: tuple[float, ...]  # of the frame itself and of those 1, 2 ... away on either side
    fine: tuple[float, ...]
    velocity: tuple[float, float, float] = (0.0, 0.0, 0.0)  # voxels from one frame to the next
    most: float = math.inf

    @classmethod
    def gaussian(cls, width: float) -> TemporalFilter:
        """Return the mean with Gaussian weights of a standard deviation in frames."""
        weights = np.exp(-0.5 * (np.arange(REACH + 1) / width) ** 2)
        weights /= weights[0] + 2 * weights[1:].sum()
        return cls(tuple(weights.tolist()), tuple(weights.tolist()))

    def apply(
        self, active: ActiveVoxels, solutions: Mapping[int, NDArray[np.float32]], place: int
    ) -> NDArray[np.float32]:
        """Return the filtered frame at a place, from solutions ``(unknowns,)`` by their places."""
        pairs = neighbours(active, solutions, place, len(self.coarse) - 1, self.velocity)
        none = np.zeros_like(pairs[0])
        low = sum((np.float32(a) * one for a, one in zip(self.coarse, pairs, strict=True)), none)
        high = sum((np.float32(b) * one for b, one in zip(self.fine, pairs, strict=True)), none)
        return np.maximum(Blur(active, SPLIT)(low - high) + high, 0).astype(np.float32)

    def report(self) -> dict[str, object]:
        """Return it as plain numbers."""
        return vars(self) | {"most": self.most if math.isfinite(self.most) else None}


def growth(
    built: WeightedSystem, before: NDArray[np.float32], after: NDArray[np.float32]
) -> float:
    """Return how many times the residual of a frame's pixels grows from one volume to another."""
    root = np.float32(1) if built.weights is None else np.sqrt(built.weights)
    projector, measured = built.system.projector, built.measured
    old, new = (norm(root * (measured - projector @ one)) for one in (before, after))
    return new / old if old > 0 else (math.inf if new > 0 else 1.0)


def neighbours(
    active: ActiveVoxels,
    solutions: Mapping[int, NDArray[np.float32]],
    place: int,
    reach: int,
    velocity: ArrayLike,
) -> list[NDArray[np.float32]]:
    """Return a frame, and the sums of the two frames 1, 2 ... away, brought to its time."""
    found = [solutions[place]]
    for away in range(1, reach + 1):
        both = []
        for step in (-1, 1):
            at = next(k for k in range(away, -1, -1) if place + step * k in solutions)
            move = -step * at * np.asarray(velocity, np.float64)
            both.append(moved(active, solutions[place + step * at], move))
        found.append(both[0] + both[1])
    return found


def moved(
    active: ActiveVoxels, values: NDArray[np.float32], move: NDArray[np.float64]
) -> NDArray[np.float32]:
    """Return unknowns moved by some voxels along x, y and z; zero comes in from outside.

    Cubic convolution along each axis (Keys, IEEE Transactions on Acoustics, Speech, and Signal
    Processing 29, 1981, with ``a = -1/2``): exact for parabolas, and next to no blur.
    """
    if not (np.abs(move) > LEAST_MOVE).any():
        return values
    volume = active.expand(values).reshape(active.grid.shape)
    for axis, distance in enumerate(move):
        if abs(distance) > LEAST_MOVE:
            volume = _along(volume, axis, float(distance))
    return active.compress(volume).astype(np.float32)


def _along(volume: NDArray[np.float32], axis: int, distance: float) -> NDArray[np.float32]:
    """Return a volume moved along one axis."""
    count = volume.shape[axis]
    whole = int(np.floor(-distance))
    s = -distance - whole  # the value is taken from `whole + s` voxels ahead
    taps = (
        s * (-0.5 + s * (1 - 0.5 * s)),
        1 + s * s * (1.5 * s - 2.5),
        s * (0.5 + s * (2 - 1.5 * s)),
        s * s * (0.5 * s - 0.5),
    )
    found = np.zeros_like(volume)
    target, source = np.moveaxis(found, axis, 0), np.moveaxis(volume, axis, 0)
    for tap, ahead in zip(taps, range(whole - 1, whole + 3), strict=True):
        first, last = max(-ahead, 0), min(count - ahead, count)
        if first < last:
            target[first:last] += np.float32(tap) * source[first + ahead : last + ahead]
    return found


def with_neighbours(block: range, count: int) -> range:
    """Return a block with the frames around it that it is filtered with, of so many frames."""
    return range(max(block.start - REACH, 0), min(block.stop + REACH, count))
