"""The stress of calibration errors: cameras are off by what is said, and rows measure it."""

import numpy as np
import pytest
from studies.common.scans import simulated_by
from studies.stress import calibration
from studies.stress.calibration_scene import (
    GRID,
    KINDS,
    VIEWS,
    noisier,
    one_off,
    seen_wrongly,
)
from studies.stress.scene import jet_by, ring

import rigs


@pytest.fixture(scope="module")
def flame():
    """Return the study's flame in pixels twice as wide, before fewer cameras."""
    rig = rigs.ring(8, distance=300.0, image_size=(28, 44), footprint=0.5, pitch_degrees=10.0)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(calibration, "FOOTPRINT", 0.5)
        yield simulated_by(rig, GRID, ("turbulent", 0), supersample=3)


@pytest.mark.parametrize("kind", KINDS)
def test_cameras_are_off_by_what_is_said(flame, kind):
    height = np.linspace(-0.5, 0.5, 201) * GRID.extent[1]
    points = np.stack([0 * height, height, 0 * height], axis=1)
    wrong = seen_wrongly(flame, kind, 1.5).rig
    for camera, other in zip(flame.rig, wrong, strict=True):
        moved = other.project(points)[0] - camera.project(points)[0]
        moved = moved if kind != "half-pixel slip" else moved[:, :1]
        assert np.sqrt(np.mean(np.sum(moved**2, axis=1))) == pytest.approx(1.5, rel=0.05)


def test_noise_added_is_that_of_the_simulation():
    plain, noisy = (jet_by(ring(2), noise=noise, seed=3) for noise in (0.0, 0.1))
    found = noisier(plain, 0.1, 3)
    for name, image in noisy.images.items():
        assert np.array_equal(found.images[name], image)
        assert not np.array_equal(plain.images[name], image)


def test_a_single_camera_is_off(flame):
    wrong = one_off(flame, 3, 2.0).rig
    assert [a != b for a, b in zip(wrong, flame.rig, strict=True)].index(True) == 3
    assert sum(a != b for a, b in zip(wrong, flame.rig, strict=True)) == 1 < VIEWS


def test_the_truth_moved_farther_is_more_wrong(flame):
    errors = [calibration.moved_truth(flame, px) for px in (0, 0.5, 1, 3)]
    assert errors[0] == 0
    assert errors == sorted(errors)


def test_the_report_says_so_from_half_a_pixel_on(flame):
    row = calibration._warned_from(flame, "focal length", "clean", (0.5,))
    assert row.holds
    assert row.figure == 0.5
    assert calibration.warnings_of(flame, "pose", 0.0) == []


def test_rows_of_growth_hold(flame, monkeypatch):
    monkeypatch.setattr(calibration, "JUDGED", (1.0,))
    least = {"sirt": calibration._error(flame, "pose", 0.0, "sirt")}
    (row,) = calibration._growth(flame, "pose", least, (1.0,))
    assert row.holds
