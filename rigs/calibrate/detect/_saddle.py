"""The corner where four squares meet, measured by fitting a model of its blurred image.

Around the corner the image is taken as

    I = a + b x + c y + (d + e x + f y) erf(p / (sqrt(2) s)) erf(q / (sqrt(2) t))

where x, y run from the corner, p and q are the distances to the two edges, which may bend, and
s and t are their blurs. All twelve numbers are fitted by least squares over the pixels around the
corner. Symmetric blur and any tone curve leave the corner's position unbiased, because a corner of
four squares looks the same after half a turn. The slopes describe uneven light.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rigs.compiled import compiled

_STEPS = 25  # of the descent; it takes some eight
_UNKNOWNS = 12  # corner, two directions, two blurs; level and contrast, each with two slopes
_CONVERGED = 2e-4  # pixels; a step shorter than this ends the descent
_MAX_STEP = 1.0  # pixels; longer steps leave the corner
_FAR = 4.0  # beyond this, erf is 1 within 2e-8
_SLOPE = 2 / math.sqrt(math.pi)  # of erf at 0


class Saddles(NamedTuple):
    """Fitted corners, one row each; NaN where the fit did not converge."""

    uv: NDArray[np.float64]  # (corners, 2), pixels
    directions: NDArray[np.float64]  # (corners, 2), angles of the two edges, radians
    blur: NDArray[np.float64]  # (corners, 2), standard deviation across each edge, pixels
    contrast: NDArray[np.float64]  # (corners,), half of white less black, signed
    misfit: NDArray[np.float64]  # (corners,), RMS of the residuals


def fit_saddles(
    image: NDArray[np.float32],
    start: NDArray[np.float64],
    axes: NDArray[np.float64],
    reach: NDArray[np.float64],
    gap: NDArray[np.float64] | None = None,
    white: NDArray[np.int64] | None = None,
    bend: NDArray[np.float64] | None = None,
) -> Saddles:
    """Fit the corners that lie within a pixel or two of ``start`` ``(corners, 2)``.

    Columns of ``axes`` ``(corners, 2, 2)`` are one square's step along the target's x and y, in
    pixels. Pixels within ``reach`` ``(corners,)`` are fitted, at most 0.45 squares along the axes.
    A quadrant with a marker is plain up to ``gap`` squares from the edges; ``white`` says which: 1
    where x y > 0, -1 where x y < 0, 0 for none. The edges' curvatures ``bend`` ``(corners, 2)``,
    1 / pixel, are positive towards an edge's left (x, y turned to -y, x).
    """
    count = len(start)
    if white is None:
        white = np.zeros(count, np.int64)
    if gap is None:
        gap = np.ones(count)
    if bend is None:
        bend = np.zeros((count, 2))
    fitted = np.full((count, _UNKNOWNS + 1), np.nan)
    _fit(image, start, axes, reach, gap, white, bend, fitted)
    return Saddles(
        fitted[:, :2], fitted[:, 2:4], fitted[:, 4:6], fitted[:, 9], fitted[:, _UNKNOWNS]
    )


@compiled
def _fit(image, start, axes, reach, gap, white, bend, fitted):
    rows, columns = image.shape
    for corner in range(len(start)):
        u, v = start[corner]
        determinant = axes[corner, 0, 0] * axes[corner, 1, 1]
        determinant -= axes[corner, 0, 1] * axes[corner, 1, 0]
        if not (abs(u) < 1e6 and abs(v) < 1e6 and 0 < reach[corner] < 1e3 and determinant != 0):
            continue
        radius = math.ceil(reach[corner])
        pixels = np.zeros(((2 * radius + 1) ** 2, 2))
        values = np.zeros(len(pixels))
        used = 0
        middle_column, middle_row = round(u), round(v)
        for row in range(middle_row - radius, middle_row + radius + 1):
            for column in range(middle_column - radius, middle_column + radius + 1):
                x, y = column - u, row - v
                if x * x + y * y > reach[corner] ** 2:
                    continue
                across = (axes[corner, 1, 1] * x - axes[corner, 0, 1] * y) / determinant
                down = (axes[corner, 0, 0] * y - axes[corner, 1, 0] * x) / determinant
                if max(abs(across), abs(down)) > 0.45:
                    continue
                if white[corner] * across * down > 0 and min(abs(across), abs(down)) > gap[corner]:
                    continue
                # Pixels and their images after half a turn are both used or both left out
                twin_column, twin_row = 2 * middle_column - column, 2 * middle_row - row
                if min(row, twin_row) < 0 or max(row, twin_row) >= rows:
                    continue
                if min(column, twin_column) < 0 or max(column, twin_column) >= columns:
                    continue
                pixels[used, 0], pixels[used, 1] = column, row
                values[used] = image[row, column]
                used += 1
        # Without contrast the equations are singular
        if used < 3 * _UNKNOWNS or values[:used].min() == values[:used].max():
            continue
        unknowns = np.zeros(_UNKNOWNS)
        unknowns[0], unknowns[1] = u, v
        unknowns[2] = math.atan2(axes[corner, 1, 0], axes[corner, 0, 0])
        unknowns[3] = math.atan2(axes[corner, 1, 1], axes[corner, 0, 1])
        unknowns[4] = unknowns[5] = 1.0
        _descend(pixels[:used], values[:used], bend[corner], unknowns, fitted[corner])


@compiled
def _descend(pixels, values, bend, unknowns, fitted):
    """Levenberg's descent; the last six unknowns are solved for at once in the first step."""
    damping = 1e-3
    normal, gradient, cost = _accumulate(pixels, values, bend, unknowns)
    linear = np.linalg.solve(normal[6:, 6:].copy(), gradient[6:].copy())
    unknowns[6:] += linear
    normal, gradient, cost = _accumulate(pixels, values, bend, unknowns)
    for _ in range(_STEPS):
        damped = normal.copy()
        for k in range(6):
            damped[k, k] *= 1 + damping
            damped[k, k] += 1e-12 * cost
        step = np.linalg.solve(damped, gradient)
        moved = math.hypot(step[0], step[1])
        if not moved < 1e6:
            return
        if moved > _MAX_STEP:
            step[:6] *= _MAX_STEP / moved
        trial = unknowns + step
        for k in (4, 5):
            trial[k] = min(max(trial[k], 0.6 * unknowns[k], 0.2), 1.6 * unknowns[k], 50.0)
        trial_normal, trial_gradient, trial_cost = _accumulate(pixels, values, bend, trial)
        if trial_cost <= cost:
            unknowns, normal, gradient = trial, trial_normal, trial_gradient
            done = moved < _CONVERGED or cost - trial_cost < 1e-9 * cost
            cost = trial_cost
            damping *= 0.2
            if done:
                fitted[:_UNKNOWNS] = unknowns
                fitted[_UNKNOWNS] = math.sqrt(cost / len(values))
                return
        else:
            damping = max(10 * damping, 1e-6)
            if damping > 1e6 or moved < _CONVERGED:
                fitted[:_UNKNOWNS] = unknowns
                fitted[_UNKNOWNS] = math.sqrt(cost / len(values))
                return


@compiled
def _accumulate(pixels, values, bend, unknowns):
    """Return the normal matrix, the gradient and the sum of squares at ``unknowns``."""
    normal = np.zeros((_UNKNOWNS, _UNKNOWNS))
    gradient = np.zeros(_UNKNOWNS)
    slope = np.zeros(_UNKNOWNS)
    cost = 0.0
    cosine, sine = math.cos(unknowns[2]), math.sin(unknowns[2])
    other_cosine, other_sine = math.cos(unknowns[3]), math.sin(unknowns[3])
    scale, other_scale = math.sqrt(0.5) / unknowns[4], math.sqrt(0.5) / unknowns[5]
    for k in range(len(values)):
        x, y = pixels[k, 0] - unknowns[0], pixels[k, 1] - unknowns[1]
        along = cosine * x + sine * y
        distance = (cosine * y - sine * x - 0.5 * bend[0] * along * along) * scale
        other_along = other_cosine * x + other_sine * y
        other = other_cosine * y - other_sine * x - 0.5 * bend[1] * other_along * other_along
        other *= other_scale
        steep = other_steep = 0.0  # derivatives by the distances, in pixels, from the edges
        contrast = unknowns[9] + unknowns[10] * x + unknowns[11] * y
        edge = 1.0 if distance > 0 else -1.0
        other_edge = 1.0 if other > 0 else -1.0
        if abs(distance) < _FAR:
            edge = math.erf(distance)
        if abs(other) < _FAR:
            other_edge = math.erf(other)
            other_steep = contrast * edge * _SLOPE * other_scale * math.exp(-other * other)
        if abs(distance) < _FAR:
            steep = contrast * other_edge * _SLOPE * scale * math.exp(-distance * distance)
        slope[0] = steep * sine + other_steep * other_sine
        slope[1] = -steep * cosine - other_steep * other_cosine
        slope[2] = -steep * along
        slope[3] = -other_steep * other_along
        slope[4] = -steep * distance / scale / unknowns[4]
        slope[5] = -other_steep * other / other_scale / unknowns[5]
        slope[6] = 1.0
        slope[7], slope[8] = x, y
        slope[9] = edge * other_edge
        slope[10], slope[11] = x * slope[9], y * slope[9]
        left = values[k] - unknowns[6] - unknowns[7] * x - unknowns[8] * y
        left -= contrast * slope[9]
        cost += left * left
        flat = steep == 0.0 and other_steep == 0.0
        for i in range(6 if flat else 0, _UNKNOWNS):
            gradient[i] += slope[i] * left
            for j in range(6 if flat else 0, i + 1):
                normal[i, j] += slope[i] * slope[j]
    for i in range(_UNKNOWNS):
        for j in range(i):
            normal[j, i] = normal[i, j]
    return normal, gradient, cost
