"""Projection matrices and DLT coefficients, by their own formulas."""

import logging

import cv2
import numpy as np
import pytest

from rigs import formats, look_at

SIZE = (640, 480)
POINTS = np.random.default_rng(0).uniform(-40, 40, (200, 3))
PLACES = [(300, 40, 200), (-250, 60, 260), (20, -80, 350)]


@pytest.fixture(scope="module")
def matrices():
    """Three cameras, with skew, that look at the origin."""
    found = []
    for number, place in enumerate(PLACES):
        R, t = look_at(place, (0, 0, 0))
        K = np.array([[800 + number, 0.5, 321.3], [0, 810, 238.4], [0, 0, 1]])
        found.append(K @ np.column_stack([R, t]))
    return found


def seen(P, points=POINTS):
    """The pixels of points by a projection matrix."""
    image = np.c_[points, np.ones(len(points))] @ P.T
    return image[:, :2] / image[:, 2:]


def coefficients(matrices):
    """The table of DLT coefficients, a column a camera."""
    return np.stack([(P / P[2, 3]).ravel()[:11] for P in matrices], axis=1)


def write(path, table, separator=","):
    path.parent.mkdir(exist_ok=True)
    rows = [separator.join(repr(float(v)) for v in row) for row in table]
    path.write_text("\n".join(rows) + "\n")
    return path


def assert_seen(rig, expected):
    for camera, uv in zip(rig, expected, strict=True):
        found, depth, valid = camera.project(POINTS)
        assert valid.all()
        assert (depth > 0).all()
        np.testing.assert_allclose(found, uv, rtol=0, atol=1e-6)
        assert camera.image_size == SIZE


@pytest.mark.parametrize("separator", [" ", ",", "\t", "; "])
def test_matrices_project_as_they_say(tmp_path, matrices, separator):
    for number, P in enumerate(matrices):
        factor = (-2.5, 1e-3, 40.0)[number]  # a projection matrix has no scale and no sign
        write(tmp_path / f"pos_{number}.txt", factor * P, separator)
    rig = formats.load(tmp_path, image_size=SIZE)
    assert rig.names == ("pos_0", "pos_1", "pos_2")
    assert_seen(rig, [seen(P) for P in matrices])
    one = formats.load(tmp_path / "pos_1.txt", image_size=SIZE)
    assert one.cameras == (rig["pos_1"],)
    assert formats.sniff(tmp_path) == formats.sniff(tmp_path / "pos_1.txt") == "projection"


def test_pmvs_folders_give_the_size_of_their_images(tmp_path, matrices):
    (tmp_path / "visualize").mkdir()
    for number, P in enumerate(matrices):
        file = write(tmp_path / "txt" / f"{number:08}.txt", P, " ")
        file.write_text("CONTOUR\n" + file.read_text())
        image = np.zeros(SIZE[::-1], np.uint8)
        cv2.imwrite(str(tmp_path / "visualize" / f"{number:08}.jpg"), image)
    assert_seen(formats.load(tmp_path / "txt"), [seen(P) for P in matrices])


def test_sizes_are_asked_for(tmp_path, matrices):
    file = write(tmp_path / "a.txt", matrices[0])
    with pytest.raises(ValueError, match=r"camera a: image_size: missing, as projection matrix"):
        formats.load(file)
    file = write(tmp_path / "a.csv", coefficients(matrices))
    with pytest.raises(ValueError, match="image_size: missing, as DLT files hold none"):
        formats.load(file)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda P: np.zeros((3, 4)), "P: found a left 3 x 3 block that is singular"),
        (lambda P: np.vstack([P[:2], [0, 0, 0, 1]]), "P: found a left 3 x 3 block that is"),
        (lambda P: np.eye(3, 4), "P: found a pose [R | t], expected K [R | t]"),
        (lambda P: np.diag([1e10, 1e10, 1]) @ P, "camera_matrix: found focal lengths 8e+12"),
    ],
)
def test_matrices_that_are_no_camera_are_refused(refused_as, tmp_path, matrices, change, message):
    file = write(tmp_path / "a.txt", change(matrices[0]))
    refused_as(f"{file}: camera a", message, file, image_size=SIZE)


def test_rows_from_the_bottom_are_found_out(tmp_path, matrices):
    flip = np.array([[1, 0, 0], [0, -1, SIZE[1] - 1.0], [0, 0, 1]])
    for number, P in enumerate(matrices):
        write(tmp_path / f"{number}.txt", flip @ P)
    with pytest.raises(ValueError, match="look away from the point where their axes meet"):
        formats.load(tmp_path, image_size=SIZE)
    # one alone has nothing that it should look at
    assert len(formats.load(tmp_path / "0.txt", image_size=SIZE)) == 1


@pytest.mark.parametrize(
    ("name", "first", "bottom"),
    [("dlt", 0, False), ("dlt_matlab", 1, False), ("dlt_bottom", 1, True)],
)
@pytest.mark.parametrize("transposed", [False, True])
def test_coefficients_project_as_they_say(tmp_path, matrices, name, first, bottom, transposed):
    count = np.array([[1.0, 0, first], [0, 1, first], [0, 0, 1]])
    if bottom:
        count[1] = [0, -1, SIZE[1] - 1 + first]  # the bottom row, SIZE[1] - 1, is the first
    table = coefficients([count @ P for P in matrices])
    file = write(tmp_path / "cal_DLTcoefs.csv", table.T if transposed else table)
    assert formats.sniff(file) == "dlt"
    rig = formats.load(file, name, image_size=SIZE)
    assert rig.names == ("cam1", "cam2", "cam3")
    assert rig.length_unit == "unit"
    assert_seen(rig, [seen(P) for P in matrices])


def test_what_a_table_does_not_say_is_noted_or_asked(tmp_path, matrices, caplog):
    file = write(tmp_path / "cal_DLTcoefs.csv", coefficients(matrices))
    with caplog.at_level(logging.WARNING):
        formats.load(file, image_size=SIZE)
    assert "pixels are counted from (0, 0) at the top left" in caplog.text
    flip = np.array([[1.0, 0, 1], [0, -1, SIZE[1]], [0, 0, 1]])
    write(file, coefficients([flip @ P for P in matrices]))
    with pytest.raises(ValueError, match="look away from their scene, expected rows counted from"):
        formats.load(file, image_size=SIZE)
    # the same where nothing but the origin says where the scene is
    write(file, coefficients([flip @ P for P in matrices[:1]]))
    with pytest.raises(ValueError, match="look away from their scene, expected rows counted from"):
        formats.load(file, image_size=SIZE)


def test_a_left_handed_world_is_mirrored_where_the_count_is_chosen(tmp_path, matrices, caplog):
    mirror = np.diag([1.0, 1, -1, 1])
    shift = np.array([[1.0, 0, 1], [0, 1, 1], [0, 0, 1]])
    file = write(tmp_path / "a.csv", coefficients([shift @ P @ mirror for P in matrices]))
    with caplog.at_level(logging.WARNING):
        rig = formats.load(file, "dlt_matlab", image_size=SIZE)
    assert "Z is negated: with rows counted from the top its cameras look away" in caplog.text
    assert rig.world_frame == "as in a.csv, Z negated"
    assert_seen(rig, [seen(P) for P in matrices])


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("1,2\n" * 10, "found 10 rows of 2 numbers, expected 11 rows"),
        ("1,2\n" * 10 + "1\n", "found 11 rows of unequal length, expected 11 rows"),
        ("1,2\n" * 10 + "1,x\n", "row 11: found 'x', expected a finite number"),
        ("1,1\n" * 11, "camera cam1: P: found a left 3 x 3 block that is singular"),
        ("", "found 0 rows of unequal length, expected 11 rows"),
    ],
)
def test_what_is_wrong_in_a_table_is_named(refused_as, tmp_path, text, message):
    file = tmp_path / "a.csv"
    file.write_text(text)
    refused_as(file, message, file, "dlt", image_size=SIZE)
