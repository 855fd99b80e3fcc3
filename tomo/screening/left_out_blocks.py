"""Pixels left out in small blocks, so that what is predicted is signal and not noise."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Self

import numpy as np
from numpy.typing import NDArray

from tomo._compute.grouping import golden_ratio_sequence
from tomo.measurement.pixel_blocks import SIDE
from tomo.operators import LinearSystem

PATCH = 16
"""Pixels along each side of a patch, whose errors count as independent of other patches'. Smaller
ones have errors in common, of larger ones there are few."""

ONE_IN = 6
"""Blocks for each that is left out. Fewer leave gaps that no volume fills, more are few to
compare on."""


@dataclass(frozen=True, eq=False)
class Blocks:
    """Blocks of pixels that are left out, and the rest.

    Attributes
    ----------
    training, left_out : (pixels,) int64
        Numbers of pixels, ascending.
    block : (pixels left out,) int64
        The block of each, numbered from 0.
    patch : (blocks,) int64
        The patch of each block, numbered from 0.
    """

    training: NDArray[np.int64]
    left_out: NDArray[np.int64]
    block: NDArray[np.int64]
    patch: NDArray[np.int64]

    @classmethod
    def of(cls, system: LinearSystem) -> Self:
        """Leave out some blocks of every view's pixels, evenly spread."""
        block, patches = blocks_of(system), _numbers(system, PATCH)
        chosen = golden_ratio_sequence(int(block.max(initial=-1)) + 1) < 1 / ONE_IN
        held = chosen[block]
        left_out = np.flatnonzero(held)
        _, first, own = np.unique(block[left_out], return_index=True, return_inverse=True)
        _, patch = np.unique(patches[left_out[first]], return_inverse=True)
        return cls(np.flatnonzero(~held), left_out, own, patch)

    def squared_errors(self, misfit: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the squares of the blocks' mean misfit, summed over patches: ``(patches,)``."""
        mean = np.bincount(self.block, misfit) / np.bincount(self.block)
        return np.bincount(self.patch, mean**2).astype(np.float64, copy=False)

    def noise(self, variance: NDArray[np.float64]) -> float:
        """Return what `squared_errors` are made of noise of a variance, ``(pixels,)``, summed."""
        counts = np.bincount(self.block)
        return float((np.bincount(self.block, variance[self.left_out]) / counts**2).sum())


def blocks_of(system: LinearSystem) -> NDArray[np.int64]:
    """Return the number of the block of each of a system's pixels, from 0 on."""
    return np.unique(_numbers(system, SIDE), return_inverse=True)[1]


def _numbers(system: LinearSystem, side: int) -> NDArray[np.int64]:
    return system.squares([side] * len(system.rig))
