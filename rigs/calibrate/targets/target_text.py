"""Targets as text, for the command line and files."""

from __future__ import annotations

from collections.abc import Callable

from rigs.calibrate.targets.boards import CharucoBoard, Chessboard, Target
from rigs.calibrate.targets.circle_grid import CircleGrid

#: The forms that `parse_target` reads.
TARGET_FORMS = (
    "chessboard:COLUMNSxROWS:SQUARE (inner corners)",
    "charuco:COLUMNSxROWS:SQUARE:MARKER:DICTIONARY[:legacy] (squares)",
    "circles:COLUMNSxROWS:SPACING[:DIAMETER]",
    "acircles:COLUMNSxROWS:SPACING[:DIAMETER] (asymmetric)",
)


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
        raise ValueError(
            f"target: {text}: found {fields[0]!r}, expected COLUMNSxROWS as in {form}"
        )
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
