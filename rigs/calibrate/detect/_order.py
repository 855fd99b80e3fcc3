"""Which point is which, where a search knows only that the points form a grid."""

from __future__ import annotations

from collections.abc import Iterator

import cv2
import numpy as np
from numpy.typing import NDArray

_FARTHEST = 0.3  # steps RMS: a strong lens bends a grid, but no further than that


def orders(uv: NDArray[np.float64], places: NDArray[np.float64], columns: int) -> Iterator:
    """Yield the orders in which points of an image can be those of the target.

    The target is seen from its front, so its axes turn in the image as the image's own do, and
    a perspective view has to explain where the points are.

    Parameters
    ----------
    uv : (points, 2) float64
        Row by row, as the search had them: any corner first, along columns or rows.
    places : (points, 2) float64
        On the target, row by row.
    columns : int
        Points in a row.

    Yields
    ------
    order : (points,) int64
        ``uv[order]`` are the images of ``places``. Of several, the one comes first that begins
        nearest the image's upper left.
    """
    grid = np.arange(len(uv)).reshape(-1, columns)
    turned = [np.rot90(side, turn) for side in (grid, grid[:, ::-1]) for turn in range(4)]
    possible = []
    for order in (side.ravel() for side in turned if side.shape == grid.shape):
        homography = cv2.findHomography(places, uv[order], 0)[0]
        if homography is None:
            continue
        off = cv2.perspectiveTransform(places[None], homography)[0] - uv[order]
        steps = np.column_stack([places - places.mean(axis=0), np.ones(len(places))])
        axes = np.linalg.lstsq(steps, uv[order], rcond=None)[0][:2]
        if np.linalg.det(axes) > 0:
            step = np.sqrt(np.linalg.det(axes))
            possible.append((np.sqrt(np.mean(off**2)) / step, order))
    least = min((off for off, _ in possible), default=1.0)
    kept = [order for off, order in possible if off < 1.01 * least + 1e-3 and off < _FARTHEST]
    yield from sorted(kept, key=lambda order: float(uv[order[0]].sum()))


def lattice(columns: NDArray, rows: NDArray, asymmetric: bool = False) -> NDArray[np.float64]:
    """Return places ``(..., 2)`` of columns and rows of a grid, in steps from row to row."""
    if asymmetric:
        columns = 2 * columns + rows % 2
    return np.stack([columns, rows], axis=-1).astype(np.float64)


def border(columns: int, rows: int, asymmetric: bool = False) -> list[NDArray[np.float64]]:
    """Return where a larger grid would go on: places ``(points, 2)`` for each of four sides."""
    across, down = np.arange(columns), np.arange(rows)
    return [
        lattice(across, np.full(columns, -1), asymmetric),
        lattice(across, np.full(columns, rows), asymmetric),
        lattice(np.full(rows, -1), down, asymmetric),
        lattice(np.full(rows, columns), down, asymmetric),
    ]
