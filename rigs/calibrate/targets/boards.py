"""Chessboards and ChArUco boards: their points, their print, and the text that names a target.

A target's axes are OpenCV's, seen from its front: x right, y down, z into the board. A camera in
front of the board is at negative z and sees x and y along columns and rows.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rigs.calibrate.targets.circle_grid import CircleGrid
from rigs.calibrate.targets.flat import Drawn, check_counts, check_length, grid, is_among

if TYPE_CHECKING:
    import cv2

#: The forms that `parse_target` reads.
TARGET_FORMS = (
    "chessboard:COLUMNSxROWS:SQUARE (inner corners)",
    "charuco:COLUMNSxROWS:SQUARE:MARKER:DICTIONARY[:legacy] (squares)",
    "circles:COLUMNSxROWS:SPACING[:DIAMETER]",
    "acircles:COLUMNSxROWS:SPACING[:DIAMETER] (asymmetric)",
)


@dataclass(frozen=True)
class Chessboard(Drawn):
    """A plain chessboard; its points are the inner corners, the first at (0, 0, 0).

    Parameters
    ----------
    columns, rows : int
        Inner corners across and down, at least 3 each: one less than squares.
    square : float
        Side of a square, in any length unit.

    Raises
    ------
    ValueError
        If a field is out of range.

    Notes
    -----
    The square up and left of the first point is black. Turned by 180 degrees, a board with an even
    and an odd side has white there, which determines the order of points. Every chessboard is its
    own mirror image: a single image does not show that it was flipped.
    """

    columns: int
    rows: int
    square: float

    def __post_init__(self) -> None:
        """Check the fields."""
        check_counts(self, 3)
        check_length(self, "square")

    def __str__(self) -> str:
        return f"chessboard:{self.columns}x{self.rows}:{self.square!r}"

    @cached_property
    def points(self) -> NDArray[np.float64]:
        """``(columns * rows, 3)`` float64, row by row."""
        return grid(self.columns, self.rows, self.square, 0)

    @property
    def extent(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Lowest and highest (x, y) of the drawing: the squares and a margin of one square."""
        high = np.array([self.columns + 1, self.rows + 1]) * self.square
        return np.full(2, -2 * self.square), high

    @property
    def ambiguity(self) -> str | None:
        """Why an image does not determine the board's pose, or None."""
        if (self.columns + self.rows) % 2:
            return None
        angle = 90 if self.columns == self.rows and self.columns % 2 == 0 else 180
        kind = "odd" if self.columns % 2 else "even"
        return (
            f"a chessboard of {self.columns}x{self.rows} inner corners, both {kind}, looks the "
            f"same turned by {angle} degrees"
        )

    def brightness(self, x: ArrayLike, y: ArrayLike) -> NDArray[np.float64]:
        """Return the print's brightness at target coordinates: 0 is black, 1 white."""
        column = np.floor(np.asarray(x, np.float64) / self.square) + 1
        row = np.floor(np.asarray(y, np.float64) / self.square) + 1
        inside = is_among(column, self.columns + 1) & is_among(row, self.rows + 1)
        return np.where(inside, (column + row) % 2, 1.0)


@dataclass(frozen=True)
class CharucoBoard(Drawn):
    """A chessboard with an ArUco marker in each white square: parts of it suffice.

    Its points are the inner corners, row by row, numbered and placed as OpenCV does: the first
    at (square, square, 0), with the origin at the outer corner of the first square.

    Parameters
    ----------
    columns, rows : int
        Squares across and down, at least 2 each and 3 of one.
    square, marker : float
        Sides of the squares and of the smaller markers, in one length unit.
    dictionary : str
        OpenCV's name, for example ``DICT_4X4_1000``.
    legacy : bool
        Boards of OpenCV before 4.6 with an even number of rows begin with a white square.

    Raises
    ------
    ValueError
        If a field is out of range or the dictionary is unknown or too small.
    """

    columns: int
    rows: int
    square: float
    marker: float
    dictionary: str
    legacy: bool = False

    def __post_init__(self) -> None:
        """Check the fields."""
        check_counts(self, 2)
        if (self.columns - 1) * (self.rows - 1) < 2:
            raise ValueError("columns: found 2x2 squares, expected at least 3x2: two points")
        check_length(self, "square")
        check_length(self, "marker")
        if self.marker >= self.square:
            raise ValueError(f"marker: found {self.marker:g}, expected less than {self.square:g}")
        capacity = len(aruco_dictionary(self.dictionary).bytesList)
        if self.columns * self.rows // 2 > capacity:
            raise ValueError(
                f"dictionary: found {self.dictionary} with {capacity} markers, expected at least "
                f"{self.columns * self.rows // 2}, one for each white square"
            )

    def __str__(self) -> str:
        return (
            f"charuco:{self.columns}x{self.rows}:{self.square!r}:{self.marker!r}:"
            f"{self.dictionary}{':legacy' if self.legacy else ''}"
        )

    @cached_property
    def points(self) -> NDArray[np.float64]:
        """``((columns - 1) * (rows - 1), 3)`` float64, row by row."""
        return grid(self.columns - 1, self.rows - 1, self.square, 1)

    @property
    def extent(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Lowest and highest (x, y) of the drawing: the squares and a margin of one square."""
        high = np.array([self.columns + 1, self.rows + 1]) * self.square
        return np.full(2, -self.square), high

    @property
    def ambiguity(self) -> str | None:
        """None: the markers identify the points."""
        return None

    @property
    def first_white(self) -> int:
        """1 where the first square is black, 0 where it is white: (column + row) % 2 of white."""
        return 0 if self.legacy and self.rows % 2 == 0 else 1

    def brightness(self, x: ArrayLike, y: ArrayLike) -> NDArray[np.float64]:
        """Return the print's brightness at target coordinates: 0 is black, 1 white."""
        x, y = np.broadcast_arrays(
            np.asarray(x, np.float64) / self.square, np.asarray(y, np.float64) / self.square
        )
        column, row = np.floor(x), np.floor(y)
        inside = is_among(column, self.columns) & is_among(row, self.rows)
        white = (column + row) % 2 == self.first_white
        bits = self._bits  # (markers, cells, cells)
        cells = bits.shape[1]
        margin = 0.5 * (1 - self.marker / self.square)
        scale = cells * self.square / self.marker
        across = np.floor((x - column - margin) * scale)
        down = np.floor((y - row - margin) * scale)
        marked = inside & white & is_among(across, cells) & is_among(down, cells)
        number = (row * self.columns + column) // 2  # row by row along the white squares
        index = [np.where(marked, part, 0).astype(np.int64) for part in (number, down, across)]
        return np.where(marked, bits[tuple(index)], np.where(inside, white, 1.0))

    @cached_property
    def _bits(self) -> NDArray[np.float64]:
        dictionary = aruco_dictionary(self.dictionary)
        cells = dictionary.markerSize + 2
        count = (self.columns * self.rows + 1) // 2
        count = min(count, len(dictionary.bytesList))
        return np.stack([dictionary.generateImageMarker(n, cells) / 255.0 for n in range(count)])


Target = Chessboard | CharucoBoard | CircleGrid


def aruco_dictionary(name: str) -> cv2.aruco.Dictionary:
    """Return OpenCV's predefined dictionary of markers called ``name``."""
    import cv2

    names = [item for item in dir(cv2.aruco) if item.startswith("DICT_")]
    if name not in names:
        raise ValueError(f"dictionary: found {name!r}, expected one of {', '.join(names)}")
    return cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, name))


def parse_target(text: str) -> Target:
    """Return the target that ``text`` describes.

    Parameters
    ----------
    text : str
        One of

        - ``chessboard:9x6:1.0``: inner corners, side of a square
        - ``charuco:5x4:0.054:0.0405:DICT_4X4_1000``: squares, sides of a square and of a marker,
          dictionary; optionally ``legacy`` as in `CharucoBoard`
        - ``circles:7x5:0.02``: a symmetric grid; its spacing, optionally a diameter
        - ``acircles:4x11:0.02``: an asymmetric grid, its spacing as in `CircleGrid`

        Lengths are in one unit of your choice, which becomes the rig's.

    Raises
    ------
    ValueError
        If the text has another form, or a field is no number or out of range.

    Examples
    --------
    >>> parse_target("chessboard:9x6:1.0")
    Chessboard(columns=9, rows=6, square=1.0)
    """
    kind, *fields = str(text).strip().split(":")
    if kind not in _READERS:
        raise ValueError(f"target: found {text!r}, expected one of: {'; '.join(TARGET_FORMS)}")
    least, most, form, read = _READERS[kind]
    if not least <= len(fields) <= most:
        raise ValueError(f"target: found {text!r}, expected {form}")
    columns, by, rows = fields[0].partition("x")
    if not (by and columns.isdecimal() and rows.isdecimal()):
        raise ValueError(f"target: {text}: found {fields[0]!r}, expected COLUMNSxROWS of {form}")
    try:
        return read(int(columns), int(rows), *fields[1:])
    except ValueError as error:
        raise ValueError(f"target: {text}: {error}") from None


def _read_charuco(columns: int, rows: int, square: str, marker: str, name: str, *rest: str):
    if rest and rest != ("legacy",):
        raise ValueError(f"legacy: found {rest[0]!r}, expected 'legacy' or nothing")
    sides = _number("square", square), _number("marker", marker)
    return CharucoBoard(columns, rows, *sides, name, legacy=bool(rest))


def _read_circles(asymmetric: bool) -> Callable[..., CircleGrid]:
    def read(columns: int, rows: int, spacing: str, diameter: str | None = None):
        size = None if diameter is None else _number("diameter", diameter)
        return CircleGrid(columns, rows, _number("spacing", spacing), asymmetric, size)

    return read


_READERS: dict[str, tuple[int, int, str, Callable[..., Target]]] = {
    "chessboard": (
        2,
        2,
        TARGET_FORMS[0],
        lambda columns, rows, square: Chessboard(columns, rows, _number("square", square)),
    ),
    "charuco": (4, 5, TARGET_FORMS[1], _read_charuco),
    "circles": (2, 3, TARGET_FORMS[2], _read_circles(False)),
    "acircles": (2, 3, TARGET_FORMS[3], _read_circles(True)),
}


def _number(field: str, text: str) -> float:
    try:
        return float(text)
    except ValueError:
        raise ValueError(f"{field}: found {text!r}, expected a number") from None
