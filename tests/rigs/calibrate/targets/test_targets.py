import cv2
import numpy as np
import pytest

from rigs.calibrate.targets import CharucoBoard, Chessboard, CircleGrid, parse_target
from rigs.calibrate.targets.boards import aruco_dictionary

CHARUCO = {  # and how many pixels a side of the square has, so that cells are whole pixels
    "charuco:5x4:0.054:0.0405:DICT_4X4_1000": 120,
    "charuco:5x4:0.054:0.0405:DICT_4X4_1000:legacy": 120,
    "charuco:6x4:2.0:1.4:DICT_5X5_100:legacy": 100,
    "charuco:6x5:1.0:0.8:DICT_6X6_250": 100,
    "charuco:5x5:1.0:0.72:DICT_7X7_50:legacy": 100,
}
OTHERS = ["chessboard:9x6:1.0", "circles:7x5:0.02:0.011", "acircles:4x11:0.02:0.014"]


@pytest.mark.parametrize("text", [*CHARUCO, *OTHERS])
def test_a_target_reads_back_from_its_text(text):
    target = parse_target(text)
    assert str(target) == text
    assert eval(repr(target)) == target
    assert target.points.shape[1] == 3
    assert not target.points[:, 2].any()


@pytest.mark.parametrize(("text", "pixels"), CHARUCO.items())
def test_charuco_is_placed_and_drawn_as_opencv_does(text, pixels):
    target = parse_target(text)
    board = cv2.aruco.CharucoBoard(
        (target.columns, target.rows),
        target.square,
        target.marker,
        aruco_dictionary(target.dictionary),
    )
    board.setLegacyPattern(target.legacy)
    np.testing.assert_allclose(target.points, board.getChessboardCorners(), rtol=1e-6)
    image, origin = target.drawing(pixels / target.square)
    np.testing.assert_allclose(origin, -target.square)
    inner = image[pixels:-pixels, pixels:-pixels]
    size = target.columns * pixels, target.rows * pixels
    np.testing.assert_array_equal(inner, board.generateImage(size, marginSize=0, borderBits=1))
    assert (np.delete(image, np.s_[pixels:-pixels], axis=0) == 255).all()


def test_an_asymmetric_grid_is_numbered_as_in_opencvs_tutorial():
    points = CircleGrid(4, 11, 2.0, asymmetric=True).points
    expected = [((2 * j + i % 2) * 2.0, i * 2.0, 0.0) for i in range(11) for j in range(4)]
    np.testing.assert_array_equal(points, expected)


@pytest.mark.parametrize("text", [*OTHERS, *CHARUCO])
def test_points_lie_where_the_drawing_has_them(text):
    """Around a point the print is its own image turned by 180 degrees; circles are dark there."""
    target = parse_target(text)
    scale = 40 / (target.points[1, 0] - target.points[0, 0])  # pixels in a unit
    image, origin = target.drawing(scale)
    for x, y, _ in target.points:
        column, row = (np.array([x, y]) - origin) * scale
        column, row = round(column), round(row)
        patch = image[row - 2 : row + 2, column - 2 : column + 2]
        if isinstance(target, CircleGrid):
            assert not patch.any()
        else:
            np.testing.assert_array_equal(patch, patch[::-1, ::-1])
            np.testing.assert_array_equal(patch, 255 - patch[::-1])


@pytest.mark.parametrize("size", [(c, r) for c in range(3, 8) for r in range(3, 8)])
@pytest.mark.parametrize("kind", ["chessboard", "circles", "acircles"])
def test_ambiguity_is_what_turning_the_drawing_shows(kind, size):
    columns, rows = size
    target = parse_target(f"{kind}:{columns}x{rows}:1.0")
    image, _ = target.drawing(8)
    turns = [k for k in (1, 2, 3) if np.array_equal(np.rot90(image, k), image)]
    if kind == "chessboard" and columns == rows and columns % 2:
        assert turns == [2]
    if turns:
        assert f"{90 if 1 in turns else 180} degrees" in target.ambiguity
    else:
        assert target.ambiguity is None


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("checkers:9x6:1", "found 'checkers:9x6:1', expected one of: chessboard:"),
        ("chessboard", "expected chessboard:COLUMNSxROWS:SQUARE"),
        ("chessboard:9x6", "expected chessboard:COLUMNSxROWS:SQUARE"),
        ("chessboard:9by6:1", "found '9by6', expected COLUMNSxROWS"),
        ("chessboard:9x-6:1", "found '9x-6', expected COLUMNSxROWS"),
        ("chessboard:2x6:1", "columns: found 2, expected an integer of at least 3"),
        ("chessboard:9x6:wide", "square: found 'wide', expected a number"),
        ("chessboard:9x6:nan", "square: found nan, expected a positive length"),
        ("chessboard:9x6:0", "square: found 0.0, expected a positive length"),
        ("chessboard:9x6:1e3000", "square: found inf, expected a positive length"),
        ("chessboard:999999x6:1", "expected at most 100000 points"),
        ("charuco:5x4:1:DICT_4X4_50", "expected charuco:COLUMNSxROWS:SQUARE:MARKER:DICTIONARY"),
        ("charuco:5x4:1:2:DICT_4X4_50", "marker: found 2, expected less than 1"),
        ("charuco:5x4:2:1:DICT_4X4_5", "dictionary: found 'DICT_4X4_5', expected one of DICT_4"),
        ("charuco:50x4:2:1:DICT_4X4_50", "found DICT_4X4_50 with 50 markers, expected at least 1"),
        ("charuco:2x2:2:1:DICT_4X4_50", "expected at least 3x2"),
        ("charuco:5x4:2:1:DICT_4X4_50:new", "legacy: found 'new'"),
        ("circles:5x4:1:1.5", "diameter: found 1.5, expected less than the distance 1"),
    ],
)
def test_a_wrong_text_is_named_field_by_field(text, message):
    with pytest.raises(ValueError, match=r"^target: ") as caught:
        parse_target(text)
    assert message in str(caught.value)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("scale", [0, -1, np.nan, np.inf, 1e9, 1e-9])
def test_a_drawing_of_no_or_too_many_pixels_is_refused(scale):
    with pytest.raises(ValueError, match="pixels_per_unit: found"):
        Chessboard(9, 6, 1.0).drawing(scale)


def test_counts_must_be_integers():
    with pytest.raises(ValueError, match=r"rows: found 4\.5, expected an integer"):
        CharucoBoard(5, 4.5, 1.0, 0.7, "DICT_4X4_50")
