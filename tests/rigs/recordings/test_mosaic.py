"""The pixels of one colour, and their rays."""

import cv2
import numpy as np
import pytest

from rigs import Camera, Distortion, RayTable, look_at
from rigs.recordings import Mosaic, without_pattern
from rigs.recordings.mosaic import COLOURS, PATTERNS

RANDOM = np.random.default_rng(0)
PLACES = {
    "RGGB": {"r": (0, 0), "g": (0, 1), "g2": (1, 0), "b": (1, 1)},
    "BGGR": {"b": (0, 0), "g": (0, 1), "g2": (1, 0), "r": (1, 1)},
    "GRBG": {"r": (0, 1), "g": (0, 0), "g2": (1, 1), "b": (1, 0)},
    "GBRG": {"b": (0, 1), "g": (0, 0), "g2": (1, 1), "r": (1, 0)},
}
EVERY = [(pattern, channel) for pattern in PATTERNS for channel in COLOURS]


def camera(size=(80, 61)):
    R, t = look_at([90, 20, 400], [0, 0, 0], [0, 1, 0])
    lens = Distortion("brown", (-0.2, 0.05, 0.001, -0.002))
    return Camera("cam", size, [[300.0, 0, 41], [0, 302.0, 29], [0, 0, 1]], lens, R, t)


@pytest.mark.parametrize(("pattern", "channel"), EVERY)
def test_pixels_are_the_sensor_s_own(pattern, channel):
    image = RANDOM.random((7, 9))
    row, column = PLACES[pattern][channel]
    found = Mosaic(pattern, channel).pixels(image)
    np.testing.assert_array_equal(found, image[row:6:2, column:8:2])


@pytest.mark.parametrize(("pattern", "channel"), EVERY)
def test_rays_are_those_through_the_pixels_own_places(pattern, channel):
    whole = camera()
    own = Mosaic(pattern, channel).camera(whole)
    assert own.image_size == (40, 30)
    row, column = PLACES[pattern][channel]
    rows, columns = np.indices((30, 40)).reshape(2, -1)
    uv = np.stack([2 * columns + column, 2 * rows + row], axis=-1)
    for found, expected in zip(own.rays(), whole.rays(uv), strict=True):
        np.testing.assert_allclose(found, expected, atol=1e-12)
    points = RANDOM.normal(size=(50, 3)) * 20
    expected = (whole.project(points)[0] - (column, row)) / 2
    np.testing.assert_allclose(own.project(points)[0], expected, atol=1e-9)


@pytest.mark.parametrize(("pattern", "channel"), EVERY)
def test_the_sensor_s_camera_comes_back(pattern, channel):
    mosaic, whole = Mosaic(pattern, channel), camera((80, 60))
    back = mosaic.sensor(mosaic.camera(whole))
    assert back.image_size == whole.image_size
    np.testing.assert_allclose(back.camera_matrix, whole.camera_matrix, rtol=1e-12)


@pytest.mark.parametrize("channel", COLOURS)
def test_a_ray_table_keeps_the_rays_of_the_colour_s_pixels(channel):
    table = RayTable.of(camera())
    row, column = PLACES["RGGB"][channel]
    found = Mosaic("RGGB", channel).camera(table).rays()[1].reshape(30, 40, 3)
    expected = table.rays()[1].reshape(61, 80, 3)[row:60:2, column:80:2]
    np.testing.assert_allclose(found, expected, atol=1e-12)


@pytest.mark.parametrize("gains", [(0.4, 1, 0.3), (2, 1, 0.1)])
@pytest.mark.parametrize("pattern", PATTERNS)
def test_brightness_without_the_pattern(pattern, gains):
    """A grey scene is seen with one brightness, whatever the colours' gains."""
    factors = np.ones((8, 10))
    red, green, blue = gains
    for channel, gain in {"r": red, "g": green, "g2": green, "b": blue}.items():
        row, column = PLACES[pattern][channel]
        factors[row::2, column::2] = gain
    np.testing.assert_allclose(without_pattern(factors), (red + 2 * green + blue) / 4, rtol=1e-6)
    edge = np.where(np.arange(10) < 5, 0.0, 1.0) * factors
    middle = np.diff(without_pattern(edge)[:, 1:-1], axis=1) @ np.arange(1.5, 8.5)
    rise = np.ptp(without_pattern(edge)[:, 1:-1], axis=1)
    np.testing.assert_allclose(middle / rise, 4.5, atol=0.5)


def test_unknown_names_and_images_too_small_are_refused():
    with pytest.raises(ValueError, match="bayer: found 'RGBG', expected one of RGGB"):
        Mosaic("RGBG", "g")
    with pytest.raises(ValueError, match="channel: found 'x', expected one of r, g, g2, b"):
        Mosaic("RGGB", "x")
    with pytest.raises(
        ValueError, match="camera cam: found 1 x 61 pixels, expected at least 2 x 2"
    ):
        Mosaic("RGGB", "r").camera(camera((1, 61)))


def test_places_are_those_of_opencv_s_demosaicing():
    """A colour's own pixels stay as they are there; OpenCV names a pattern by its second row."""
    image = RANDOM.integers(0, 255, (12, 14), dtype=np.uint8)
    codes = {
        "RGGB": cv2.COLOR_BayerBG2RGB,
        "BGGR": cv2.COLOR_BayerRG2RGB,
        "GRBG": cv2.COLOR_BayerGB2RGB,
        "GBRG": cv2.COLOR_BayerGR2RGB,
    }
    for pattern, code in codes.items():
        full = cv2.cvtColor(image, code)
        for channel in COLOURS:
            own = full[:, :, "rgb".index(channel[0])]
            found = Mosaic(pattern, channel).pixels(image)
            expected = Mosaic(pattern, channel).pixels(own)
            np.testing.assert_array_equal(found[1:-1, 1:-1], expected[1:-1, 1:-1])
