"""The standard deviation that noise leaves in every voxel of what a method returns."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tomo.condition._noise import Solve, generator, noise_of_images, smoothed
from tomo.linear_system import LinearSystem, Progress
from tomo.live_voxels import LiveVoxels

KEPT = 0.7
"""Pixels, the standard deviation of the blur by which noise is taken out of the residual."""

NEIGHBOURS = 0.5
"""Voxels, the standard deviation of the blur by which neighbours share what the repeats found: few
repeats scatter, the noise's share of neighbouring voxels differs little."""


@dataclass(frozen=True, eq=False)
class Deviations:
    """What repeating a reconstruction with new noise gave.

    Attributes
    ----------
    values : (unknowns,) float32
        Standard deviation in the volume's unit.
    repeats : int
    noise : (pixels,) float64
        Standard deviation of the pixels' noise.
    """

    values: NDArray[np.float32]
    repeats: int
    noise: NDArray[np.float64]

    @property
    def scatter(self) -> float:
        """Relative standard error of each value: ``1 / sqrt(2 (repeats - 1))``."""
        return 1 / (2 * (self.repeats - 1)) ** 0.5


def standard_deviations(
    system: LinearSystem,
    measured: NDArray[np.float32],
    seen: NDArray[np.float32],
    solve: Solve,
    *,
    repeats: int,
    seed: int = 0,
    progress: Progress | None = None,
) -> Deviations:
    """Repeat a reconstruction with new noise and return the spread of its voxels.

    Parameters
    ----------
    system : LinearSystem
    measured, seen : (pixels,) float32
        The images, and the volume found from them re-projected.
    solve : callable
        The reconstruction.
    repeats : int
        At least 2.
    seed : int
        Of the noise; every repeat has a generator of its own.
    progress : callable, optional

    Notes
    -----
    A parametric bootstrap (Efron and Tibshirani, "An Introduction to the Bootstrap", 1993,
    chapter 6) of the whole solve: non-negativity, smoothness and early stopping are in it. The
    noise is put on the re-projected images plus the residual blurred by `KEPT` pixels: what the
    volume cannot explain presses voxels against zero and has to stay, the noise that the images
    already have must not count twice. What no repeat can show is not in it: what smoothing and
    missing views leave out, the choice of the method, and noise that neighbouring pixels share.
    The square roots of the voxels' deviations are blurred by `NEIGHBOURS`: those next to zero
    differ by powers of ten, and their mean would be the largest one's.
    """
    noise = noise_of_images(system, measured, seen, solve, seed)
    base = seen + smoothed(system, measured - seen, KEPT)
    mean = np.zeros(system.projector.shape[1])
    squares = np.zeros_like(mean)
    for number in range(repeats):
        if progress:
            progress(number, repeats, "standard deviations")
        random = generator(seed, 1 + number)
        images = (base + noise * random.standard_normal(len(noise))).astype(np.float32)
        volume = solve(images)
        step = volume - mean
        mean += step / (number + 1)
        squares += step * (volume - mean)
    if progress:
        progress(repeats, repeats, "standard deviations")
    values = _shared(np.sqrt(squares / (repeats - 1)), system.projector.live)
    return Deviations(values.astype(np.float32), repeats, noise)


def _shared(values: NDArray[np.float64], live: LiveVoxels) -> NDArray[np.float64]:
    """Return deviations (unknowns,) of which each has taken up some of its neighbours'."""
    from scipy.ndimage import gaussian_filter

    def blurred(unknowns: NDArray[np.float64]) -> NDArray[np.float64]:
        volume = live.expand(unknowns).reshape(live.grid.shape)
        return live.compress(gaussian_filter(volume, NEIGHBOURS, mode="constant"))

    return (blurred(np.sqrt(values)) / blurred(np.ones_like(values))) ** 2
