"""The standard deviation of every voxel by noise: a parametric bootstrap of the solve."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from itertools import islice

import numpy as np
from numpy.typing import NDArray

from tomo.operators import LinearSystem
from tomo.operators.system import Progress
from tomo.uncertainty.bootstrap_calibration import Spread, calibrated, neighbour_means
from tomo.uncertainty.residual_noise import Solve, generator, smoothed

KEPT = 0.7
"""Standard deviation, in pixels, of the blur that removes noise from the residual."""

NEIGHBOURS = 0.5
"""Standard deviation, in voxels, of the blur over the voxels' deviations: few repeats scatter more
than true deviations differ between neighbours."""

CALIBRATED = 20
"""Repeats from which on half of them are a second bootstrap that calibrates the first."""


@dataclass(frozen=True, eq=False)
class Deviations:
    """The result of repeating a reconstruction with new noise."""

    values: NDArray[np.float32]  # (unknowns,): standard deviation in the volume's unit
    repeats: int
    noise: NDArray[np.float64]  # (pixels,): the pixels' standard deviation

    @property
    def scatter(self) -> float:
        """Relative standard error of ``n`` repeats' spread: ``1 / sqrt(2 (n - 1))``.

        Without those that calibrate; of what comes of calibrating it is less.
        """
        return 1 / (2 * (self.repeats - _calibrating(self.repeats) - 1)) ** 0.5


def standard_deviations(
    system: LinearSystem,
    measured: NDArray[np.float32],
    seen: NDArray[np.float32],
    noise: NDArray[np.float64],
    solve: Solve,
    *,
    repeats: int,
    seed: int = 0,
    progress: Progress | None = None,
) -> Deviations:
    """Repeat a reconstruction with new noise, twice or more, and return the spread of its voxels.

    A parametric bootstrap (Efron and Tibshirani, "An Introduction to the Bootstrap", 1993, chapter
    6) of the whole solve: non-negativity, smoothness and early stopping are in it. ``noise``, the
    pixels' standard deviations, is put on the re-projected images ``seen`` plus the residual
    blurred by `KEPT` pixels: what the volume cannot explain presses voxels against zero and has to
    stay, the noise that the images already have must not count twice. What no repeat can show is
    not in it: what smoothing and missing views leave out, the choice of the method, and noise that
    neighbouring pixels share. Every repeat has a generator of its own.

    How firmly voxels without emission are held at zero hangs on the noise of the one set that
    there is. From `CALIBRATED` repeats on the second half of them treats a noisy set of the first
    half as the measured one, and what that gets wrong is corrected, see `calibrated`. Of fewer,
    the square roots of the deviations are blurred by `NEIGHBOURS`: those next to zero differ by
    powers of ten, and their mean would be the largest one's.
    """
    active = system.projector.active

    def generators() -> Iterator[np.random.Generator]:
        for number in range(repeats):
            if progress:
                progress(number, repeats, "standard deviations")
            yield generator(seed, 1 + number)

    drawn, inner = generators(), _calibrating(repeats)
    base = bootstrap_images(system, measured, seen)
    first, images, volume = _repeated(base, noise, solve, islice(drawn, repeats - inner))
    if inner:
        again = (system.projector @ volume).astype(np.float32)
        base = bootstrap_images(system, images, again)
        values = calibrated(first, _repeated(base, noise, solve, drawn)[0], active)
    else:
        values = neighbour_means(np.sqrt(first.deviation), NEIGHBOURS, active) ** 2
    if progress:
        progress(repeats, repeats, "standard deviations")
    return Deviations(values.astype(np.float32), repeats, noise)


def bootstrap_images(
    system: LinearSystem, measured: NDArray[np.float32], seen: NDArray[np.float32]
) -> NDArray[np.float32]:
    """Return re-projected images plus the residual blurred by `KEPT` pixels, ``(pixels,)``."""
    return seen + smoothed(system, measured - seen, KEPT)


def _calibrating(repeats: int) -> int:
    """Return the number of repeats in the second bootstrap."""
    return repeats // 2 if repeats >= CALIBRATED else 0


def _repeated(
    base: NDArray[np.float32],
    noise: NDArray[np.float64],
    solve: Solve,
    generators: Iterable[np.random.Generator],
) -> tuple[Spread, NDArray[np.float32], NDArray[np.float32]]:
    """Solve images with new noise from each generator.

    Returns the `Spread` of the volumes, updated one by one: they need not be kept; the first noisy
    images (pixels,), and their volume (unknowns,).
    """
    count, mean, squares = 0, np.zeros(()), np.zeros(())
    for count, random in enumerate(generators, 1):
        noisy = (base + noise * random.standard_normal(len(noise))).astype(np.float32)
        volume = solve(noisy)
        if count == 1:
            images, found = noisy, volume
        step = np.subtract(volume, mean, dtype=np.float64)
        mean = mean + step / count
        squares = squares + step * (volume - mean)
    return Spread(np.sqrt(squares / (count - 1)), mean), images, found
