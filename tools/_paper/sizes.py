"""How large the paper's experiments are: in full, and the size that a test runs."""

from __future__ import annotations

from dataclasses import dataclass

PAPER_SAMPLES = 32
"""Samples of 100 rays in the paper's batches."""


@dataclass(frozen=True)
class Problem:
    """What is reconstructed, from how large images.

    Attributes
    ----------
    grid_shape, spacing
        Voxels of the paper's box of 15 x 70 x 15 mm.
    shrink : int
        By how much the presets' images are shrunk.
    """

    grid_shape: tuple[int, int, int]
    spacing: float
    shrink: int


@dataclass(frozen=True)
class Sizes:
    """The numbers that make one run of the experiments longer than another.

    Attributes
    ----------
    name : str
    large : Problem
        Of the jet in the paper's three layouts, and of the noisy images.
    epochs_in_full : int
        Of the jet in the layouts.
    problem : Problem
        Of the other parts, but for the readings.
    epochs : int
        Of all other runs from scratch.
    transfer_epochs : int
        With an encoder that was trained on another flame.
    homogeneous_epochs : int
        On the random homogeneous set, which fills the box and takes longest.
    readings : Problem
        Where the readings are compared.
    reading_epochs : int
    finer_epochs : int
        On noisy images, and on those shrunk half as much, whose rays are four times as many.
    first_steps : int
        Steps whose loss is recorded one by one.
    sweeps : int
        The most that ART is given.
    """

    name: str
    large: Problem
    epochs_in_full: int
    problem: Problem
    epochs: int
    transfer_epochs: int
    homogeneous_epochs: int
    readings: Problem
    reading_epochs: int
    finer_epochs: int
    first_steps: int
    sweeps: int


_PAPER = Problem((30, 140, 30), 0.5, 2)
_HALF = Problem((15, 70, 15), 1.0, 4)
_SMALL = Problem((6, 28, 6), 2.5, 10)
FULL = Sizes(
    name="full",
    large=_PAPER,
    epochs_in_full=80,
    problem=_PAPER,
    epochs=40,
    transfer_epochs=20,
    homogeneous_epochs=10,
    readings=_HALF,
    reading_epochs=10,
    finer_epochs=20,
    first_steps=96,
    sweeps=40,
)
HALF = Sizes(
    name="half",
    large=_PAPER,
    epochs_in_full=30,
    problem=_HALF,
    epochs=20,
    transfer_epochs=20,
    homogeneous_epochs=10,
    readings=_HALF,
    reading_epochs=10,
    finer_epochs=15,
    first_steps=96,
    sweeps=40,
)
QUICK = Sizes(
    name="quick",
    large=_SMALL,
    epochs_in_full=4,
    problem=_SMALL,
    epochs=3,
    transfer_epochs=2,
    homogeneous_epochs=2,
    readings=_SMALL,
    reading_epochs=1,
    finer_epochs=2,
    first_steps=5,
    sweeps=5,
)
