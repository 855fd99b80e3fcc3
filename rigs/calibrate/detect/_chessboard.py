"""Detection of chessboards, complete ones only."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from rigs.calibrate.detect._corners import are_corners, refine_corners
from rigs.calibrate.detect.found import Found, Search, border, lattice, local_axes, orders
from rigs.calibrate.targets import Chessboard

_FALLBACK = 800  # pixels of the longer side, for the slower search that tolerates more blur


def find_chessboard(search: Search, target: Chessboard) -> Found:
    """Return the board's inner corners in an image."""
    size = f"{target.columns}x{target.rows}"
    rough = _rough(search, target)
    if rough is None:
        return Found.nothing(f"no chessboard of {size} inner corners")
    row, column = np.divmod(np.arange(len(rough)), target.columns)
    positions = lattice(column, row)
    possible = list(orders(rough, positions, target.columns))
    if not possible:
        return Found.nothing(f"no chessboard of {size} inner corners")
    upright = max(possible, key=lambda order: _first_is_black(search, target, rough[order]))
    saddles, good = refine_corners(search.whole, positions, rough[upright])
    # Positive where the square right and down of the corner is black; all change sign in negatives
    black = np.sign(saddles.contrast) * (1 - 2 * ((column + row) % 2))
    if len(np.unique(black[good])) != 1:
        return Found.nothing(
            f"a grid of {size}, but not of black and white squares that alternate"
        )
    whole = good.reshape(target.rows, target.columns)
    outer = [whole[0], whole[-1], whole[:, 0], whole[:, -1]]
    if np.mean(good) < 0.8 or min(np.mean(side) for side in outer) <= 0.5:
        return Found.nothing(f"a chessboard of less than {size} inner corners, or a damaged one")
    if _continues(search.whole, target, positions, saddles, good):
        return Found.nothing(f"a chessboard of more than {size} inner corners")
    blur = float(np.median(saddles.blur[good]))
    return Found(np.flatnonzero(good), saddles.uv[good], blur)


def counted_chessboard(search: Search) -> tuple[tuple[int, int], bool] | None:
    """Return a chessboard's columns and rows of inner corners, and whether neighbours of them fit.

    A count aslant may be off by one: the neighbours are looked for as whole boards.
    """
    flags = cv2.CALIB_CB_LARGER | cv2.CALIB_CB_NORMALIZE_IMAGE
    found, _, squares = cv2.findChessboardCornersSBWithMeta(search.small, (3, 3), flags)
    if not found:
        return None
    rough = tuple(sorted(squares.shape, reverse=True))
    steps = [(0, 0), (-1, 0), (0, -1), (1, 0), (0, 1), (-1, -1), (1, 1)]
    sizes = dict.fromkeys(
        tuple(sorted((rough[0] + across, rough[1] + down), reverse=True)) for across, down in steps
    )
    for size in sizes:
        if min(size) >= 3 and len(find_chessboard(search, Chessboard(*size, 1.0)).point):
            return size, True
    return rough, False


def _rough(search: Search, target: Chessboard) -> NDArray[np.float64] | None:
    """Return the corners ``(points, 2)`` within one or two pixels, in any order of a grid."""
    size = (target.columns, target.rows)
    flags = cv2.CALIB_CB_ADAPTIVE_THRESH | cv2.CALIB_CB_NORMALIZE_IMAGE
    found, corners = cv2.findChessboardCorners(search.small, size, flags=flags)
    if found:
        return search.in_whole(corners.reshape(-1, 2))
    shrink = max(1.0, max(search.small.shape) / _FALLBACK)
    wanted = [round(length / shrink) for length in search.small.shape[::-1]]
    small = cv2.resize(search.small, wanted, interpolation=cv2.INTER_AREA)
    coarse = Search(search.whole, np.asarray(small, np.uint8))
    found, corners = cv2.findChessboardCornersSB(coarse.small, size, flags=0)
    return coarse.in_whole(corners.reshape(-1, 2)) if found else None


def _first_is_black(search: Search, target: Chessboard, uv: NDArray[np.float64]) -> bool:
    """Return whether the square right and down of the first corner is dark."""
    grid = uv.reshape(target.rows, target.columns, 2)
    middle = (grid[:-1, :-1] + grid[1:, :-1] + grid[:-1, 1:] + grid[1:, 1:]) / 4
    column, row = np.round(middle).astype(int).reshape(-1, 2).T
    limits = search.whole.shape
    shade = search.whole[np.clip(row, 0, limits[0] - 1), np.clip(column, 0, limits[1] - 1)]
    odd = np.add.outer(np.arange(target.rows - 1), np.arange(target.columns - 1)).ravel() % 2
    return bool(np.median(shade[odd == 0]) < np.median(shade[odd == 1]))


def _continues(image, target, positions, saddles, good) -> bool:
    """Return whether corners of squares continue beyond one of the sides."""
    homography = cv2.findHomography(positions[good], saddles.uv[good], 0)[0]
    usual = np.median(np.abs(saddles.contrast[good]))
    for side in border(target.columns, target.rows):
        uv = cv2.perspectiveTransform(side[None], homography)[0]
        inside = ((uv > 4) & (uv < np.array(image.shape[::-1]) - 5)).all(axis=-1)
        if np.count_nonzero(inside) < 3:
            continue
        known = np.concatenate([positions[good], side[inside]])
        axes = local_axes(known, np.concatenate([saddles.uv[good], uv[inside]]))
        outer = np.count_nonzero(good)
        if np.mean(are_corners(image, uv[inside], axes[outer:], 0.5 * usual)) > 0.5:
            return True
    return False
