"""Rows and columns that a sensor did not read are found, and nothing else is."""

import numpy as np
import pytest

from rigs import ring
from tomo import Scan
from tomo.measurement import find_dead_lines
from tomo.simulation import camera_noise

ROWS, COLUMNS = np.mgrid[0:60, 0:50]
BLOB = np.exp(-(((ROWS - 30) / 12) ** 2) - ((COLUMNS - 25) / 8) ** 2).astype(np.float32)


def counted(image, pedestal=100):
    """Return what a camera of 12 bits with noise stores of an image."""
    noisy = camera_noise.poisson(image, 5000, 8.0, np.random.default_rng(0))
    return camera_noise.quantise(0.85 * noisy + pedestal / 4095, 12, 1.0)


@pytest.mark.parametrize("value", [0, 100, 4095])
@pytest.mark.parametrize("image", [counted(BLOB), counted(BLOB, 0), np.round(3000 * BLOB)])
def test_dead_lines_are_found_whatever_they_hold(image, value):
    broken = image.copy()
    broken[28] = broken[:, 20] = broken[:, 21] = value
    broken[28, 20:22] = value
    found = find_dead_lines(broken)
    if value:  # a column that another line crosses holds one value where both do
        assert (found.rows, found.columns) == ((28,), (20, 21))
    assert found.rows == (28,)
    assert str(find_dead_lines(np.delete(broken, [20, 21], axis=1))) == "row 28"


def gap(height):
    image = np.zeros((40, 40), np.float32)
    image[10:20, 5:35] = image[20 + height : 30, 5:35] = 1
    return image


@pytest.mark.parametrize(
    "image",
    [
        BLOB,
        counted(BLOB),
        counted(BLOB, 0),
        np.where(abs(ROWS - 30) < 9, BLOB, 0),  # sharp edges, exactly dark beside them
        np.minimum(BLOB, 0.4),  # a saturated core
        np.full((30, 30), 0.3, np.float32),
        np.where(ROWS < 20, np.float32(0.2), np.float32(0.5)),  # a flat background and a floor
        gap(3),
        np.zeros((9, 9)),
        np.full((9, 9), np.nan),
    ],
)
def test_faultless_images_have_none(image):
    assert not find_dead_lines(image)
    assert not find_dead_lines(image.T)


def test_they_are_left_out_before_images_are_shrunk_and_are_named():
    image = counted(np.kron(BLOB, np.ones((2, 2))))
    image[61] = 0
    rig = ring(1, distance=200.0, image_size=image.shape[::-1], footprint=0.5)
    scan = Scan.from_arrays(rig, {rig.names[0]: image}).scaled(4)
    _, (usable,), _, dead, _ = scan.read_with_faults()
    assert np.flatnonzero(~usable.any(axis=1)).tolist() == [15]
    assert usable.sum() == usable.size - usable.shape[1]
    assert {name: str(lines) for name, lines in dead.items()} == {rig.names[0]: "row 61"}
