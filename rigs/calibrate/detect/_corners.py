"""Corners of chessboards measured to a few hundredths of a pixel, from rough positions."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from rigs.calibrate.detect._saddle import Saddles, fit_saddles
from rigs.calibrate.detect.found import is_flat_patch, local_axes, smooth_map

_REACH = 16.0  # pixels around a corner; farther ones add more lens bending than information
_SMALLEST_SIDE = 5.0  # pixels of a square; smaller ones leave too few for the fit
_PLAIN = 0.6  # pixels between the blurred edges of a square and of its marker
_MARGIN = 1.5  # pixels of a marker's blur, before the blur is known


def refine_corners(
    image: NDArray[np.float32],
    positions: NDArray[np.float64],
    start: NDArray[np.float64],
    gap: float | None = None,
    white: NDArray[np.int64] | None = None,
) -> tuple[Saddles, NDArray[np.bool_]]:
    """Measure corners whose rough position ``start`` is known, in pixels; False where none is.

    ``positions`` are on the board, in squares. With markers, ``gap`` is the plain strip between a
    marker and its square, in squares, and ``white`` is 1 where the quadrants with markers are
    those with x y > 0, -1 where x y < 0. No corner is where the fit does not converge, moves away,
    or leaves large residuals.
    """
    axes = local_axes(positions, start)
    start = _near_corners(image, start, axes, gap)
    blur = np.full(len(positions), _MARGIN / 2)
    bend = None
    for _ in range(2):
        axes = local_axes(positions, start)
        saddles, good = _fit(image, start, axes, gap, white, blur, bend)
        if not is_flat_patch(positions[good]):  # too few, or on one line: no map of the plane
            return saddles, np.zeros(len(good), bool)
        smooth, _ = smooth_map(positions[good], saddles.uv[good])
        off = np.linalg.norm(saddles.uv[good] - smooth, axis=-1)
        good[good] = off < 0.15 * _shortest_side(axes[good])
        start = np.where(good[:, None], saddles.uv, start)
        blur = np.where(good, saddles.blur.max(axis=-1), blur)
        bend = np.zeros((len(positions), 2))
        if is_flat_patch(positions[good]):
            bending = smooth_map(positions[good], start[good])[1]
            bend[good] = _curvature(local_axes(positions[good], start[good]), bending)
    return saddles, good


def are_corners(
    image: NDArray[np.float32], start: NDArray[np.float64], axes: NDArray[np.float64], least: float
) -> NDArray[np.bool_]:
    """Return at which positions ``(corners, 2)`` squares meet with at least that contrast."""
    start = _near_corners(image, start, axes, None)
    blur = np.full(len(start), _MARGIN / 2)
    saddles, good = _fit(image, start, axes, None, None, blur, None)
    return good & (np.abs(np.nan_to_num(saddles.contrast)) > least)


def _fit(image, start, axes, gap, white, blur, bend) -> tuple[Saddles, NDArray[np.bool_]]:
    """Fit the corners once, and test each fit."""
    side = _shortest_side(axes)
    plain = None if gap is None else np.maximum(gap - 2 * blur / side, 1 / side)
    reach = np.minimum(0.64 * side, _REACH)
    saddles = fit_saddles(image, start, axes, reach, plain, white, bend)
    good = np.isfinite(saddles.uv).all(axis=-1) & (side >= _SMALLEST_SIDE)
    moved = np.linalg.norm(saddles.uv - start, axis=-1)
    with np.errstate(invalid="ignore"):
        good &= moved < np.maximum(0.2 * side, 1.0)
        good &= saddles.misfit < 0.3 * np.abs(saddles.contrast)
        good &= saddles.blur.max(axis=-1) < 0.25 * side
        if gap is not None:
            # At grazing angles markers are close to the edges and shift the corner by a tenth of a
            # pixel. Where squares are small in every direction nothing better is possible
            needed = 2 * saddles.blur.max(axis=-1) + _PLAIN
            longest = np.linalg.norm(axes, axis=1).max(axis=-1)
            good &= (gap * side > needed) | (gap * longest < needed)
    return saddles, good


def _near_corners(
    image: NDArray[np.float32],
    start: NDArray[np.float64],
    axes: NDArray[np.float64],
    gap: float | None,
) -> NDArray[np.float64]:
    """Move each start to within a few tenths of a pixel, in a window that fits its squares."""
    side = _shortest_side(axes)
    window = np.round(np.clip(0.3 * side if gap is None else 0.7 * gap * side, 2, 11))
    criteria = (cv2.TERM_CRITERIA_EPS + cv2.TERM_CRITERIA_MAX_ITER, 30, 0.01)
    near = start.copy()
    limits = np.array(image.shape[::-1]) - 1
    for k, half in enumerate(window.astype(int).tolist()):
        if (start[k] < 0).any() or (start[k] > limits).any():
            continue
        found = cv2.cornerSubPix(
            image, start[k].astype(np.float32).reshape(1, 1, 2), (half, half), (-1, -1), criteria
        )
        if np.linalg.norm(found[0, 0] - start[k]) <= half:
            near[k] = found[0, 0]
    return near


def _shortest_side(axes: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the shortest extent of the squares around each corner, in pixels ``(corners,)``."""
    return np.abs(np.linalg.det(axes)) / np.linalg.norm(axes, axis=1).max(axis=-1)


def _curvature(axes: NDArray[np.float64], bending: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the curvature of both edges ``(corners, 2)``, in 1 / pixel, positive to the left."""
    along = axes.transpose(0, 2, 1)  # (corners, edges, 2)
    cross = along[..., 0] * bending[..., 1] - along[..., 1] * bending[..., 0]
    return cross / np.linalg.norm(along, axis=-1) ** 3
