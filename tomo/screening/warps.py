"""Moving a predicted image onto a measured one by a few amounts, with the linear neighbourhood."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Self

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter, map_coordinates

STEPS = 8
"""Gauss-Newton steps at most."""

FIRST_BLUR = 3.0
"""Standard deviation of the blur, in pixels, of the images that the first steps compare: details
narrower than a large motion lead astray."""

LARGEST_STEP = 3.0
"""Largest change of an amount in a step, in pixels."""

LEAST_GAIN = 1e-3
"""Fraction by which a step must lower the squared error for another one."""

FINER = 0.2
"""Fraction of a pixel that the last differences are taken over."""

KINDS = ("shift", "roll", "bend")

Image = NDArray[np.float64]


def motions_of(kind: str, shape: tuple[int, int]) -> NDArray[np.float64]:
    """Return motions ``(K, 2, rows, columns)``: the displacement right and down, in pixels.

    ``shift``: right, down. ``roll``: these, and a turn that moves corners by a pixel. ``bend``:
    both components are polynomials of second order.
    """
    rows, columns = np.indices(shape, float)
    down, right = rows - (shape[0] - 1) / 2, columns - (shape[1] - 1) / 2
    one, none = np.ones(shape), np.zeros(shape)
    shift = [[one, none], [none, one]]
    if kind == "shift":
        return np.array(shift)
    corner = max(float(np.hypot(down, right).max()), 1.0)
    x, y = right / corner, down / corner
    if kind == "roll":
        return np.array([*shift, [-y, x]])
    shapes = [x, y, x * x, x * y, y * y]
    return np.array([*shift, *([s, none] for s in shapes), *([none, s] for s in shapes)])


@dataclass(frozen=True, eq=False)
class Fit:
    """A prediction at the best-fitting amounts, and how it changes around them.

    Attributes
    ----------
    predicted : (rows, columns)
    slopes : (K, rows, columns)
        Change of the prediction with each amount.
    amounts : (K,)
    mask : (rows, columns) bool
    displacement : float
        Root mean square over the image's edges, in pixels.
    """

    predicted: Image
    slopes: NDArray[np.float64]
    amounts: NDArray[np.float64]
    mask: NDArray[np.bool_]
    displacement: float = 0.0

    def refitted(self, measured: Image, where: NDArray[np.bool_]) -> Image:
        """Return the prediction with the amounts fitted to the pixels ``where``, linearised."""
        change = _step(self.slopes[:, where], (measured - self.predicted)[where])
        return np.asarray(self.predicted + np.tensordot(change, self.slopes, 1), np.float64)


def _step(slopes: NDArray[np.float64], residual: NDArray[np.float64]) -> NDArray[np.float64]:
    normal = slopes @ slopes.T
    if not np.trace(normal) > 0:
        return np.zeros(len(slopes))
    normal += 1e-6 * np.diag(np.diag(normal)) + 1e-12 * np.trace(normal) * np.eye(len(normal))
    return np.asarray(np.linalg.solve(normal, slopes @ residual), np.float64)


def register_motions(
    predicted: Image, measured: Image, mask: NDArray[np.bool_], motions: NDArray[np.float64]
) -> Fit:
    """Fit the amounts of motions by Gauss-Newton steps, first on blurred images.

    Parameters
    ----------
    predicted, measured : (rows, columns)
    mask : (rows, columns) bool
    motions : (K, 2, rows, columns)
        See `motions_of`.
    """
    amounts = np.zeros(len(motions))
    filled = np.where(mask, measured, predicted)
    for blur in (FIRST_BLUR, 0.0):
        one, other = (gaussian_filter(i, blur) if blur else i for i in (predicted, filled))
        best = np.inf
        for _ in range(STEPS):
            moved, slopes = _moved(one, motions, amounts)
            residual = (other - moved)[mask]
            error = float(residual @ residual)
            if error >= best:
                break
            best, kept = error, amounts
            step = _step(slopes[:, mask], residual)
            amounts = amounts + np.clip(step, -LARGEST_STEP, LARGEST_STEP)
        amounts = kept
    moved, slopes = _moved(predicted, motions, amounts)
    down, right = np.gradient(moved)
    edges = np.where(mask, down**2 + right**2, 0)
    square = np.sum(np.tensordot(amounts, motions, 1) ** 2, axis=0)
    total = float(edges.sum())
    size = float(np.sqrt((edges * square).sum() / total)) if total > 0 else 0.0
    return Fit(moved, slopes, amounts, mask, size)


def _moved(
    image: Image, motions: NDArray[np.float64], amounts: NDArray[np.float64]
) -> tuple[Image, NDArray[np.float64]]:
    right, down = np.tensordot(amounts, motions, 1)
    rows, columns = np.indices(image.shape, float)
    moved = map_coordinates(image, [rows - down, columns - right], order=1, mode="nearest")
    slope_down, slope_right = np.gradient(moved)
    return moved, -(slope_right * motions[:, 0] + slope_down * motions[:, 1])


@dataclass(frozen=True, eq=False)
class Moved(Fit):
    """The fit of a prediction that is computed anew for other amounts."""

    @classmethod
    def by(
        cls,
        reproject: Callable[[NDArray[np.float64]], Image],
        steps: NDArray[np.float64],
        measured: Image,
        mask: NDArray[np.bool_],
        start: Image,
    ) -> Self:
        """Fit the amounts by Gauss-Newton steps with differences over ``steps`` (K,).

        The differences become finer where a step does not lower the error.
        """
        amounts, at, finer = np.zeros(len(steps)), start, 1.0
        residual = (measured - at)[mask]
        for _ in range(STEPS):
            there = (reproject(amounts + step) for step in np.diag(finer * steps))
            slopes = np.array([image - at for image in there]) / finer
            change = np.clip(_step(slopes[:, mask], residual), -LARGEST_STEP, LARGEST_STEP)
            moved = reproject(amounts + change * steps)
            left = (measured - moved)[mask]
            if float(left @ left) < (1 - LEAST_GAIN) * float(residual @ residual):
                amounts, at, residual = amounts + change * steps, moved, left
            elif finer < 1:
                break
            else:
                finer = FINER
        return cls(at, slopes, amounts, mask)
