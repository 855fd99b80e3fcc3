"""How large the paper's experiments are: in full, half, and the size that a test runs."""

from __future__ import annotations

from dataclasses import dataclass

PAPER_SAMPLES = 32
"""Samples of 100 rays in the paper's batches."""


@dataclass(frozen=True)
class Problem:
    """Voxels of the paper's box of 15 x 70 x 15 mm, and by how much images are shrunk."""

    grid_shape: tuple[int, int, int]
    spacing: float
    shrink: int


@dataclass(frozen=True)
class Sizes:
    """The numbers that make one run of the experiments longer than another.

    Attributes
    ----------
    large, problem, readings : Problem
        Of the jet's layouts and of the noisy images; of the readings; of the other parts.
    epochs_in_full, epochs : int
        Of the jet in the layouts; of all other runs from scratch.
    transfer_epochs, homogeneous_epochs : int
        With an encoder that was trained on another flame; on the random homogeneous set.
    reading_epochs, finer_epochs : int
        Of the readings; on noisy images, and on those shrunk half as much.
    sweeps : int
        The most that ART is given.
    """

    large: Problem
    problem: Problem
    readings: Problem
    epochs_in_full: int
    epochs: int
    transfer_epochs: int
    homogeneous_epochs: int
    reading_epochs: int
    finer_epochs: int
    sweeps: int


_PAPER = Problem((30, 140, 30), 0.5, 2)
_HALF = Problem((15, 70, 15), 1.0, 4)
_TINY = Problem((6, 28, 6), 2.5, 10)
SIZES = {
    "full": Sizes(_PAPER, _PAPER, _HALF, 80, 40, 20, 10, 10, 20, 40),
    "half": Sizes(_PAPER, _HALF, _HALF, 30, 20, 20, 10, 10, 15, 40),
    "tiny": Sizes(_TINY, _TINY, _TINY, 4, 3, 2, 2, 1, 2, 5),
}
