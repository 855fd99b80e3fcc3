"""Assignment of grid points to target points, where a search gives an unordered grid."""

from __future__ import annotations

from collections.abc import Iterator

import cv2
import numpy as np
from numpy.typing import NDArray

_FARTHEST = 0.3  # grid steps RMS from a homography; a strong lens stays below


def orders(uv: NDArray[np.float64], positions: NDArray[np.float64], columns: int) -> Iterator:
    """Yield the possible orders of an image's points as the target's points.

    The target is seen from its front, so its axes have the image's handedness, and a homography
    maps its points to the image.

    Parameters
    ----------
    uv : (points, 2) float64
        Row by row as the search gives them: any corner first, along columns or rows.
    positions : (points, 2) float64
        On the target, row by row.
    columns : int
        Points in a row.

    Yields
    ------
    order : (points,) int64
        ``uv[order]`` are the images of ``positions``. The order whose first point is nearest to
        the image's upper left comes first.
    """
    grid = np.arange(len(uv)).reshape(-1, columns)
    turned = [np.rot90(side, turn) for side in (grid, grid[:, ::-1]) for turn in range(4)]
    possible = []
    for order in (side.ravel() for side in turned if side.shape == grid.shape):
        homography = cv2.findHomography(positions, uv[order], 0)[0]
        if homography is None:
            continue
        off = cv2.perspectiveTransform(positions[None], homography)[0] - uv[order]
        steps = np.column_stack([positions - positions.mean(axis=0), np.ones(len(positions))])
        axes = np.linalg.lstsq(steps, uv[order], rcond=None)[0][:2]
        if np.linalg.det(axes) > 0:
            step = np.sqrt(np.linalg.det(axes))
            possible.append((np.sqrt(np.mean(off**2)) / step, order))
    least = min((off for off, _ in possible), default=1.0)
    kept = [order for off, order in possible if off < 1.01 * least + 1e-3 and off < _FARTHEST]
    yield from sorted(kept, key=lambda order: float(uv[order[0]].sum()))


def lattice(columns: NDArray, rows: NDArray, asymmetric: bool = False) -> NDArray[np.float64]:
    """Return positions ``(..., 2)`` of columns and rows of a grid, in row spacings."""
    if asymmetric:
        columns = 2 * columns + rows % 2
    return np.stack([columns, rows], axis=-1).astype(np.float64)


def border(columns: int, rows: int, asymmetric: bool = False) -> list[NDArray[np.float64]]:
    """Return the positions ``(points, 2)`` next to each of a grid's four sides."""
    across, down = np.arange(columns), np.arange(rows)
    return [
        lattice(across, np.full(columns, -1), asymmetric),
        lattice(across, np.full(columns, rows), asymmetric),
        lattice(np.full(rows, -1), down, asymmetric),
        lattice(np.full(rows, columns), down, asymmetric),
    ]
