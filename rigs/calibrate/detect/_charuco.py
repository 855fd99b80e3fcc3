"""Detection of ChArUco boards: any part with a few markers suffices."""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from rigs.calibrate.detect._corners import refine_corners
from rigs.calibrate.detect.found import Found, Search, is_flat_patch
from rigs.calibrate.targets import CharucoBoard
from rigs.calibrate.targets.boards import aruco_dictionary

_NEIGHBOURS = 4  # markers from which a corner's position is predicted
_FAR = 1.3  # squares from a corner to its nearest marker; farther predictions are inexact


class _Markers(NamedTuple):
    """Markers read: numbers, corners in pixels, and corners on the board in squares."""

    number: NDArray[np.int64]  # (markers,)
    uv: NDArray[np.float64]  # (markers, 4, 2)
    positions: NDArray[np.float64]  # (markers, 4, 2)


def find_charuco(search: Search, target: CharucoBoard, both_layouts: bool = True) -> Found:
    """Return the board's inner corners in an image or its negative, in either layout if asked.

    Where the markers in view fit both, the target's own is taken and ``legacy`` is None.
    """
    reason = ""
    layouts = [target.first_white]
    if both_layouts and target.rows % 2 == 0:
        layouts.append(1 - target.first_white)
    for image in (search, search.negative()):
        number, uv = _read(image, target.dictionary)
        fitting = [_on_board(number, uv, target, first_white) for first_white in layouts]
        counts = [len(markers.number) for markers in fitting]
        best = int(np.argmax(counts))
        if counts[best] >= 2:
            found = _corners(image, target, layouts[best], fitting[best])
            if len(found.point):
                tied = counts.count(counts[best]) == len(counts)
                return replace(found, legacy=None if tied else layouts[best] == 0)
            reason = reason or found.reason
        reason = reason or _why(number, target)
    return Found.nothing(reason)


def other_dictionary(search: Search, target: CharucoBoard) -> str | None:
    """Return the name of another dictionary whose markers are in the image, but not its own."""
    if len(_read(search, target.dictionary)[0]) >= 4:  # larger dictionaries contain these
        return None
    names = [name for name in dir(cv2.aruco) if name.startswith("DICT_")]
    counts = {name: len(_read(search, name)[0]) for name in names if name != target.dictionary}
    best = max(counts, key=lambda name: counts[name])
    return best if counts[best] >= 4 else None


def other_counts(search: Search, target: CharucoBoard) -> tuple[int, int] | None:
    """Return the columns and rows of squares that the markers in the image fit, if others.

    Columns and rows exchanged come first; then up to four more or fewer of each.
    """
    number, uv = _read(search, target.dictionary)
    if not len(number):
        number, uv = _read(search.negative(), target.dictionary)
    if len(number) < _NEIGHBOURS:
        return None
    own = target.columns, target.rows
    near = [(own[0] + a, own[1] + b) for a in range(-4, 5) for b in range(-4, 5)]
    near.sort(key=lambda size: abs(size[0] - own[0]) + abs(size[1] - own[1]))
    best, most = None, 0.9 * len(number)
    for columns, rows in dict.fromkeys([own[::-1], *near]):
        white = columns * rows // 2
        if min(columns, rows) < 2 or (columns, rows) == own or white <= number.max():
            continue
        try:
            board = replace(target, columns=columns, rows=rows)
        except ValueError:  # more markers than the dictionary has
            continue
        fitting = max(len(_on_board(number, uv, board, first).number) for first in (0, 1))
        # Boards of more rows have the same markers in the same places: the fewest rows say most
        if fitting > most:
            best, most = (columns, rows), fitting
    return best


def _read(search: Search, dictionary: str) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    """Return numbers ``(markers,)`` and corners ``(markers, 4, 2)`` in the whole image."""
    parameters = cv2.aruco.DetectorParameters()
    parameters.minMarkerPerimeterRate = 0.015
    detector = cv2.aruco.ArucoDetector(aruco_dictionary(dictionary), parameters)
    corners, number, _ = detector.detectMarkers(search.small)
    if number is None or not len(number):
        return np.zeros(0, np.int64), np.zeros((0, 4, 2))
    return number.reshape(-1).astype(np.int64), search.in_whole(np.reshape(corners, (-1, 4, 2)))


def _on_board(number, uv, target: CharucoBoard, first_white: int) -> _Markers:
    """Return the markers that are arranged as on the board; none if most are not."""
    row, column = np.mgrid[: target.rows, : target.columns]
    white = (row + column) % 2 == first_white
    squares = np.stack([column[white], row[white]], axis=-1)  # (markers, 2), in their order
    once = np.isin(number, np.flatnonzero(np.bincount(number, minlength=1) == 1))
    known = once & (number < len(squares))
    number, uv = number[known], uv[known]
    side = target.marker / target.square
    corner = 0.5 + side * np.array([[-0.5, -0.5], [0.5, -0.5], [0.5, 0.5], [-0.5, 0.5]])
    positions = squares[number][:, None] + corner  # (markers, 4, 2)
    fits = _agree_with_neighbours(uv, positions)
    if np.count_nonzero(fits) <= 0.7 * len(fits):
        fits[:] = False
    return _Markers(number[fits], uv[fits], positions[fits])


def _agree_with_neighbours(
    uv: NDArray[np.float64], positions: NDArray[np.float64]
) -> NDArray[np.bool_]:
    """Return which markers' corners predict most of their neighbours' positions.

    Only neighbours are compared, because a lens may bend the board as a whole.
    """
    fits = np.zeros(len(uv), bool)
    middles, seen = positions.mean(axis=1), uv.mean(axis=1)
    for k in range(len(uv)):
        apart = np.linalg.norm(middles - middles[k], axis=-1)
        near = np.argsort(apart, kind="stable")[1 : 1 + _NEIGHBOURS]
        own = np.column_stack([positions[k] - middles[k], np.ones(4)])
        affine = np.linalg.lstsq(own, uv[k], rcond=None)[0]  # (3, 2)
        off = (
            np.column_stack([middles[near] - middles[k], np.ones(len(near))]) @ affine - seen[near]
        )
        side = np.sqrt(abs(np.linalg.det(affine[:2])))  # pixels of a square
        allowed = 0.4 * side * np.maximum(apart[near], 1)
        fits[k] = len(near) > 0 and np.mean(np.linalg.norm(off, axis=-1) < allowed) >= 0.5
    return fits


def _corners(search: Search, target: CharucoBoard, first_white: int, markers: _Markers) -> Found:
    """Measure the corners that have a marker of the board nearby."""
    positions = target.points[:, :2] / target.square  # (points, 2)
    middles = markers.positions.mean(axis=1)
    apart = np.linalg.norm(positions[:, None] - middles[None], axis=-1)  # (points, markers)
    start = np.full(positions.shape, np.nan)
    for k in np.flatnonzero(apart.min(axis=1) < _FAR):
        near = np.argsort(apart[k], kind="stable")[:_NEIGHBOURS]
        local = cv2.findHomography(
            markers.positions[near].reshape(-1, 2), markers.uv[near].reshape(-1, 2), 0
        )[0]
        if local is not None:
            start[k] = cv2.perspectiveTransform(positions[None, None, k], local)[0, 0]
    limits = np.array(search.whole.shape[::-1]) - 3
    point = np.flatnonzero(((start > 2) & (start < limits)).all(axis=-1))
    if not is_flat_patch(positions[point]):
        return Found.nothing("a few markers, but too few corners of the board")
    # 1 where the squares with markers are up left and down right of the corner
    white = np.where(positions[point].sum(axis=-1) % 2 == first_white, 1, -1)
    gap = 0.5 * (1 - target.marker / target.square)
    saddles, good = refine_corners(search.whole, positions[point], start[point], gap, white)
    good &= np.sign(saddles.contrast) == -white
    if not is_flat_patch(positions[point[good]]):
        return Found.nothing("too few corners of the board that can be measured")
    return Found(point[good], saddles.uv[good], float(np.median(saddles.blur[good])))


def _why(number: NDArray[np.int64], target: CharucoBoard) -> str:
    if not len(number):
        return f"no markers of {target.dictionary}"
    found = ", ".join(str(item) for item in np.unique(number)[:6])
    more = ", ..." if len(np.unique(number)) > 6 else ""
    return (
        f"markers {found}{more} of {target.dictionary}, but not arranged as on a board of "
        f"{target.columns}x{target.rows} squares"
    )
