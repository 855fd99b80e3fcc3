"""Causes are fitted to what they did to an image, and what is done about them undoes it."""

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter, map_coordinates

import rigs
from tomo import VoxelGrid
from tomo.screening.camera_causes import CAUSES
from tomo.screening.left_out_view import LeftOutView
from tomo.screening.remedies import ADVICE, remedy
from tomo.screening.single_camera import CameraFinding

NOISE = 0.004
ROWS, COLUMNS = np.indices((60, 72), float)


def flame(rows, columns):
    """Return two unlike blobs and a streak, of no symmetry."""
    return (
        np.exp(-(((rows - 24) / 8) ** 2) - ((columns - 30) / 12) ** 2)
        + 0.7 * np.exp(-(((rows - 40) / 4) ** 2) - ((columns - 45) / 5) ** 2)
        + 0.4 * np.exp(-(((rows - columns * 0.6) / 3) ** 2) - ((columns - 36) / 20) ** 2)
    )


def turned(degrees):
    turn, rows, columns = np.deg2rad(degrees), ROWS - 29.5, COLUMNS - 35.5
    return flame(
        29.5 + np.cos(turn) * rows - np.sin(turn) * columns,
        35.5 + np.sin(turn) * rows + np.cos(turn) * columns,
    )


PREDICTED = flame(ROWS, COLUMNS)
OTHER = map_coordinates(PREDICTED, [59 - ROWS * 0.8, COLUMNS * 0.7], order=1)
MADE = {
    "gain": 0.85 * PREDICTED,
    "background": PREDICTED + 0.02,
    "saturation": np.minimum(PREDICTED, 0.6),
    "blur": gaussian_filter(PREDICTED, 2.0),
    "swapped": OTHER,
    "mirrored": PREDICTED[:, ::-1],
    "hidden": np.where(COLUMNS < 28, 0, PREDICTED),
    "pointing": flame(ROWS - 1.3, COLUMNS + 0.8),
    "out of step": flame(ROWS + 2.5 * np.sin(COLUMNS / 14), COLUMNS + 2.5 * np.cos(ROWS / 13 + 1)),
}


def explained(image, seed=0):
    """Return the view, and the causes, the likeliest first."""
    noise = NOISE * np.random.default_rng(seed).standard_normal(image.shape)
    view = LeftOutView(
        image + noise,
        PREDICTED,
        np.ones(image.shape, bool),
        np.full(image.shape, NOISE**2),
        {"cam09": OTHER},
    )
    found = [one for cause in CAUSES if (one := cause.fit(view)) is not None]
    return view, sorted(found, key=lambda one: max(one.excess, 0.0) * one.penalty)


@pytest.mark.parametrize("cause", MADE)
def test_each_cause_is_the_likeliest_of_what_it_did(cause):
    view, found = explained(MADE[cause])
    assert found[0].cause == cause
    assert found[0].excess < 0.1 * view.excess(view.predicted)
    assert ADVICE[cause]("cam03", found[0])


def test_a_rolled_camera_points_elsewhere():
    assert explained(turned(4.0))[1][0].cause == "pointing"


def test_parameters_are_those_of_the_fault():
    wanted = {"gain": ("gain", 0.85), "background": ("level", 0.02), "blur": ("pixels", 2.0)}
    for cause, (name, value) in wanted.items():
        assert explained(MADE[cause])[1][0].parameters[name] == pytest.approx(value, rel=0.06)
    assert explained(MADE["hidden"])[1][0].parameters == {"left": 28}
    assert explained(MADE["pointing"])[1][0].pose[3:] == pytest.approx([-0.8, 1.3], abs=0.05)


def test_held_out_pixels_reward_no_parameters_where_nothing_is_wrong():
    for seed in range(5):
        view, found = explained(PREDICTED, seed)
        chance = NOISE**2 * np.sqrt(2 * view.mask.sum())
        assert min(one.excess for one in found) > view.excess(view.predicted) - chance


def finding(cause, error=0.3):
    view, found = explained(MADE[cause])
    given = view.excess(view.predicted)
    return CameraFinding(0, "cam00", error, 0.02, 0.5, tuple(found[:2]), given, 0.03, 0.04)


def done(cause, **allowed):
    rig = rigs.ring(1, distance=300.0, image_size=(72, 60), footprint=0.5)
    grid = VoxelGrid((20, 20, 20), 1.0)
    how = {"move": True, "scale": True} | allowed
    return remedy(finding(cause), rig[0], MADE[cause].astype(np.float32), grid, 1, **how), rig[0]


@pytest.mark.parametrize("cause", ["gain", "background"])
def test_scaled_images_are_the_others_again(cause):
    image = done(cause)[0].corrected(MADE[cause].astype(np.float32))
    assert image == pytest.approx(PREDICTED, abs=2e-3)


def test_hidden_and_saturated_pixels_are_left_out():
    hidden = done("hidden")[0].unusable
    assert hidden[:, :28].all()
    assert not hidden[:, 31:].any()
    cut = done("saturation")[0].unusable
    assert cut[PREDICTED > 0.6].all()
    assert not cut[PREDICTED < 0.5].any()


def test_a_moved_camera_sees_points_where_the_image_has_them():
    found, camera = done("pointing")
    before, after = (one.project(np.zeros((1, 3)))[0][0] for one in (camera, found.camera))
    assert after - before == pytest.approx([-0.8, 1.3], abs=0.05)


@pytest.mark.parametrize("cause", ["swapped", "mirrored", "blur", "out of step"])
def test_what_has_no_correction_is_excluded_only_where_it_misleads(cause):
    assert done(cause)[0].excluded
    rig = rigs.ring(1, distance=300.0, image_size=(72, 60), footprint=0.5)
    grid, image = VoxelGrid((20, 20, 20), 1.0), MADE[cause].astype(np.float32)
    little = remedy(finding(cause, 0.07), rig[0], image, grid, 1, move=True, scale=True)
    assert not little.excluded
    assert not little.words


def test_nothing_is_moved_or_scaled_that_may_not_be():
    assert done("pointing", move=False)[0].camera is None
    assert done("gain", scale=False)[0].gain == 1
