"""Detection in rendered photographs, whose truth is known to any digit."""

import functools
from dataclasses import replace

import cv2
import numpy as np
import pytest
from scipy.interpolate import RectBivariateSpline
from scipy.spatial.transform import Rotation

from rigs import Camera, Distortion
from rigs.calibrate.detect import detections, find_target, observe
from rigs.calibrate.detect._corners import refine_corners
from rigs.calibrate.targets import parse_target

CAMERA = Camera(
    "cam",
    (320, 240),
    np.array([[400.0, 0, 158.3], [0, 400.0, 121.2], [0, 0, 1]]),
    Distortion("brown", (-0.15, 0.05, 1e-3, -5e-4)),
)
SAMPLES = 6
BOARDS = (
    "chessboard:9x6:1.0",
    "charuco:7x5:0.054:0.0405:DICT_4X4_1000",
    "circles:7x5:20.0",
    "acircles:4x11:0.02",
)
LIMITS = (0.004, 0.004, 0.01, 0.01)  # pixels RMS without noise


@pytest.fixture(scope="module")
def directions():
    """Directions of the rays through every part of every pixel, on the plane at distance one."""
    sizes = np.array(CAMERA.image_size)
    # The lens is smooth: cubics between rays four pixels apart are exact to 1e-8 of a pixel
    u, v = (np.linspace(-0.5, size - 0.5, size // 4 + 1) for size in sizes)
    _, rays = CAMERA.rays(np.stack(np.meshgrid(u, v), axis=-1).reshape(-1, 2))
    plane = (rays[:, :2] / rays[:, 2:]).reshape(len(v), len(u), 2)
    fine = [(np.arange(size * SAMPLES) + 0.5) / SAMPLES - 0.5 for size in sizes[::-1]]
    splines = (RectBivariateSpline(v, u, plane[:, :, axis]) for axis in range(2))
    return np.stack([spline(*fine) for spline in splines], axis=-1)


@pytest.fixture(scope="module")
def photograph(directions):
    """Return a function that renders a target in a pose: image and where its points truly are."""

    @functools.cache  # rendering takes most of the time
    def clean(target, roll, tilt, fill, shift, blur):
        low, high = target.points[:, :2].min(axis=0), target.points[:, :2].max(axis=0)
        distance = max((high - low) / np.array([320, 240])) * 400 / fill
        R = Rotation.from_euler("zxy", [roll, *tilt], degrees=True).as_matrix()
        t = np.array([*shift, 1]) * distance - R @ np.append((low + high) / 2, 0)
        inverse = np.linalg.inv(np.column_stack([R[:, 0], R[:, 1], t]))
        board = directions @ inverse[:, :2].T + inverse[:, 2]
        x, y = board[..., 0] / board[..., 2], board[..., 1] / board[..., 2]
        low, high = target.extent
        inside = (x > low[0]) & (x < high[0]) & (y > low[1]) & (y < high[1])
        image = np.full(x.shape, 110.0)
        image[inside] = 40 + 160 * target.brightness(x[inside], y[inside])
        image = cv2.GaussianBlur(image, (0, 0), blur * SAMPLES)
        image = image.reshape(240, SAMPLES, 320, SAMPLES).mean(axis=(1, 3))
        uv, _, _ = CAMERA.project(target.points @ R.T + t)
        return image, uv

    def take(target, roll=10.0, tilt=(20.0, -25.0), fill=0.7, shift=(0, 0), blur=0.6, noise=0):
        image, uv = clean(target, roll, tilt, fill, shift, blur)
        image = image + noise * np.random.default_rng(0).standard_normal(image.shape)
        return np.clip(np.round(image), 0, 255).astype(np.uint8), uv

    return take


def error(found, truth):
    return np.sqrt(np.mean((found.uv - truth[found.point]) ** 2))


@pytest.mark.parametrize(
    ("text", "exact", "noisy"),
    [(text, exact, 0.012 + exact) for text, exact in zip(BOARDS, LIMITS, strict=True)],
)
def test_points_are_found_without_bias_and_little_moved_by_noise(photograph, text, exact, noisy):
    target = parse_target(text)
    for noise, limit in ((0, exact), (4, noisy)):
        image, truth = photograph(target, noise=noise)
        found = find_target(image, target)
        assert len(found.point) == len(target.points)
        assert error(found, truth) < limit


@pytest.mark.parametrize("blur", [1.2, 2.0])
def test_blur_is_measured_and_moves_no_corner(photograph, blur):
    target = parse_target(BOARDS[0])
    image, truth = photograph(target, blur=blur, noise=1, fill=0.8)
    found = find_target(image, target)
    assert found.blur == pytest.approx(blur, abs=0.05)
    assert error(found, truth) < 0.02


@pytest.mark.parametrize("text", BOARDS[:2])
def test_light_that_falls_off_and_a_tone_curve_move_no_corner(photograph, text):
    target = parse_target(text)
    image, truth = photograph(target)
    light = np.linspace(0.4, 1, 320) * np.linspace(1, 0.6, 240)[:, None]
    shaded = 255 * (light * image / 255) ** 1.5
    found = find_target(shaded.astype(np.float32), target)
    assert len(found.point) == len(target.points)
    assert error(found, truth) < 0.008
    assert np.abs((found.uv - truth[found.point]).mean(axis=0)).max() < 0.003


@pytest.mark.parametrize("text", [BOARDS[0], BOARDS[1], BOARDS[3]])
def test_points_keep_their_numbers_however_the_target_is_turned(photograph, text):
    target = parse_target(text)
    for roll in (95, 170):
        image, truth = photograph(target, roll=roll, tilt=(-20, 15), fill=0.6)
        found = find_target(image, target)
        assert len(found.point) == len(target.points)
        assert error(found, truth) < 0.02


@pytest.mark.parametrize("text", BOARDS)
def test_a_negative_print_is_found_in_the_same_places(photograph, text):
    target = parse_target(text)
    image, truth = photograph(target)
    found = find_target(255 - image, target)
    assert len(found.point) == len(target.points)
    if text == BOARDS[1] or text == BOARDS[3]:
        assert error(found, truth) < 0.02
    else:  # black for white is the board turned, or the grid is ambiguous: another first point
        off = np.linalg.norm(found.uv[:, None] - truth, axis=-1).min(axis=1)
        assert off.max() < 0.05


def test_sixteen_bits_and_floats_are_measured_in_full(photograph):
    target = parse_target(BOARDS[0])
    image, _ = photograph(target)
    whole = find_target(image, target)
    for other in ((image * 7.0 - 300).astype(np.float32), image.astype(np.uint16) * 100):
        np.testing.assert_allclose(find_target(other, target).uv, whole.uv, atol=1e-3)


def test_a_part_of_a_charuco_board_is_enough(photograph):
    target = parse_target(BOARDS[1])
    image, truth = photograph(target, fill=1.3, shift=(0.2, 0.1), noise=2)
    inside = ((truth > 8) & (truth < np.array([320, 240]) - 9)).all(axis=1)
    found = find_target(image, target)
    assert 6 <= inside.sum() < len(target.points)
    assert len(found.point) >= 0.75 * inside.sum()
    assert error(found, truth) < 0.04
    assert (np.diff(found.point) > 0).all()


def test_a_black_hole_in_the_image_hides_the_corner_in_it_and_no_other(photograph):
    target = parse_target("charuco:4x3:1.0:0.5:DICT_4X4_50")
    image, truth = photograph(target, fill=0.5)
    column, row = np.round(truth[1]).astype(int)
    image[row - 18 : row + 19, column - 18 : column + 19] = 0
    assert find_target(image, target).point.tolist() == [0, 2, 3, 4, 5]


def test_both_layouts_of_a_charuco_board_are_tried(photograph):
    target = parse_target("charuco:5x4:0.054:0.0405:DICT_4X4_1000")
    image, truth = photograph(replace(target, legacy=True))
    assert error(find_target(image, target), truth) < 0.01
    assert error(find_target(image, replace(target, legacy=True)), truth) < 0.01


def test_a_layout_that_one_image_leaves_open_is_settled_by_the_others(photograph):
    """Without the markers at the ends of rows, both layouts fit, one column apart."""
    target = parse_target("charuco:5x4:0.054:0.0405:DICT_4X4_1000")
    whole, _ = photograph(replace(target, legacy=True))
    image, truth = photograph(replace(target, legacy=True), roll=0, tilt=(0, 0), fill=1.0)
    image[:, int(truth[:, 0].max()) + 4 :] = 255
    alone = find_target(image, target)
    assert alone.legacy is None
    assert error(alone, truth) > 5
    seen = observe({"cam": {"whole": whole, "part": image}}, target)
    part = seen.where(seen.frame == 1)
    off = np.linalg.norm(part.uv - truth[part.point], axis=1)
    assert off.max() < 0.1


def test_other_boards_are_not_taken_for_the_target(photograph):
    image, _ = photograph(parse_target("charuco:5x4:1.0:0.75:DICT_4X4_50"))
    for text, said in (
        ("charuco:4x5:1.0:0.75:DICT_4X4_50", "not arranged as on a board of 4x5 squares"),
        ("charuco:5x4:1.0:0.75:DICT_7X7_50", "no markers of DICT_7X7_50"),
        ("circles:4x3:1.0", "no grid of 4x3 circles"),
    ):
        found = find_target(image, parse_target(text))
        assert not len(found.point)
        assert said in found.reason
    image, _ = photograph(parse_target("chessboard:7x6:1.0"))
    for size in ("6x5", "5x4", "8x6"):
        assert not len(find_target(image, parse_target(f"chessboard:{size}:1.0")).point)
    image, _ = photograph(parse_target("circles:7x6:1.0"))
    for size in ("6x5", "7x5", "8x6"):
        assert not len(find_target(image, parse_target(f"circles:{size}:1.0")).point)


def test_a_mirrored_board_is_reported(photograph):
    target = parse_target(BOARDS[1])
    image, _ = photograph(target)
    with pytest.raises(ValueError, match=r"camera cam: frame 1: found the target mirrored"):
        observe({"cam": {"1": np.ascontiguousarray(image[:, ::-1])}}, target)


def test_another_dictionary_is_reported(photograph):
    image, _ = photograph(parse_target("charuco:5x4:1.0:0.75:DICT_5X5_50"))
    with pytest.raises(ValueError, match=r"found markers of DICT_5X5_\d+, expected charuco:5x4"):
        observe({"cam": {"1": image}}, parse_target("charuco:5x4:1.0:0.75:DICT_6X6_50"))


def test_blurred_images_are_listed(photograph):
    target = parse_target(BOARDS[0])
    images = {str(k): photograph(target, noise=k)[0] for k in range(3)}
    images["9"] = photograph(target, blur=3.0, fill=0.8)[0]
    found = detections({"cam": images}, target)
    ((camera, frame, blur),) = found.blurred()
    assert (camera, frame) == ("cam", "9")
    assert blur == pytest.approx(3.0, abs=0.3)


def test_corners_on_one_line_alone_are_no_board():
    """One of two rows of corners is plain paper: the other gives no map of the plane."""
    squares = np.indices((2, 8)).sum(axis=0) % 2
    image = cv2.resize(squares.astype(np.float32), (160, 40), interpolation=cv2.INTER_NEAREST)
    image = cv2.GaussianBlur(np.pad(image, 40, constant_values=1.0), (0, 0), 0.8)
    positions = np.array([(x, y) for y in (0, 1) for x in range(7)], np.float64)
    saddles, good = refine_corners(image, positions, 20 * positions + [59.5, 59.5])
    assert np.allclose(saddles.uv[:7], 20 * positions[:7] + [59.5, 59.5], atol=0.05)
    assert not good.any()
