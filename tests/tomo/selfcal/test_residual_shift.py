"""Cameras that differ from the rig raise a warning; exact cameras raise none."""

from dataclasses import replace
from types import SimpleNamespace

import cv2
import numpy as np
import pytest

import phantoms
import rigs
from rigs import Distortion
from tomo.grid import VoxelGrid
from tomo.pipeline.register import displacement_warning, register
from tomo.selfcal.residual_shift import Displacement
from tomo.selfcal.shifts import align_views
from tomo.simulation import simulate_images

GRID = VoxelGrid((18, 36, 18), 0.5)
VIEWS = 8
PLACES = ((30, 35), (14, 50), (45, 15), (20, 20), (40, 55))  # of a flame in images


@pytest.fixture(scope="module", params=[0.0, 0.1], ids=["clean", "noisy"])
def case(request):
    rig = rigs.ring(VIEWS, distance=300.0, image_size=(48, 76), footprint=0.27, pitch_degrees=10)
    field = phantoms.create("turbulent", seed=2, extent=GRID.extent)
    made = simulate_images(rig, field, GRID, supersample=2, refine=2, noise=request.param)
    return SimpleNamespace(rig=rig, images=[made.images[name] for name in rig.names])


def warned(case, change, cameras=range(VIEWS)):
    """Return the warnings for a rig with ``change(camera, sign)`` applied to some cameras."""
    wrong = tuple(
        change(camera, 1 if number % 3 else -1) if number in cameras else camera
        for number, camera in enumerate(case.rig)
    )
    masks = [np.ones(image.shape, bool) for image in case.images]
    found = register(
        replace(case.rig, cameras=wrong), case.images, masks, GRID, align=True, margin=None
    )
    displaced = displacement_warning(found.alignment, found.rig.names, False)
    warnings = [*found.record.warnings, *displaced]
    return [line for line in warnings if "disagree" in line or "beside" in line]


def zoomed(camera, sign, fraction=0.05):
    matrix = camera.camera_matrix.copy()
    matrix[[0, 1], [0, 1]] *= 1 + sign * fraction
    return replace(camera, camera_matrix=matrix)


def bent(camera, sign):
    return replace(camera, distortion=Distortion("brown", (-100.0 * sign, 0, 0, 0)))


def turned(camera, sign, pixels=1.2):
    step = sign * pixels / camera.camera_matrix[0, 0]
    turn = cv2.Rodrigues(np.array([0.6, 0.8, 0]) * step)[0]
    return replace(camera, R=turn @ camera.R, t=turn @ camera.t)


@pytest.mark.parametrize("change", [zoomed, bent, turned])
def test_cameras_wrong_by_pixels_raise_a_warning(case, change):
    assert warned(case, change)


def test_the_right_rig_raises_no_warning(case):
    assert warned(case, lambda camera, sign: camera) == []


def test_a_third_of_a_pixel_raises_no_warning(case):
    assert warned(case, lambda camera, sign: turned(camera, sign, 0.3)) == []


def test_a_single_camera_is_named(case):
    lines = warned(case, lambda camera, sign: zoomed(camera, sign, 0.2), cameras=[5])
    assert len(lines) == 1
    assert "cam05" in lines[0]


def test_a_common_factor_of_all_focal_lengths_is_no_contradiction(case):
    assert warned(case, lambda camera, sign: zoomed(camera, 1, 0.01)) == []


@pytest.mark.parametrize(("pixels", "made"), [(4.0, True), (8.0, False)])
def test_large_shifts_are_accepted_and_too_large_ones_raise_a_warning(case, pixels, made):
    wrong = tuple(turned(camera, (-1) ** n, pixels) for n, camera in enumerate(case.rig))
    found = align_views(replace(case.rig, cameras=wrong), case.images, GRID)
    assert found.accepted == made
    assert found.displacement.disagrees != found.accepted


@pytest.mark.parametrize("fraction", [0.0, 0.06])
def test_what_exact_cameras_on_an_arc_would_show_is_allowed(fraction):
    """Predictions of a smooth jet from few views on one side are too wide for exact cameras."""
    grid = VoxelGrid((20, 60, 20), 0.5)
    size = {"distance": 300.0, "image_size": (64, 120), "footprint": 0.3}
    rig = rigs.arc(4, span_degrees=90, pitch_degrees=[9.0, -5.0] * 2, **size)
    made = simulate_images(
        rig, phantoms.create("jet", seed=2, extent=grid.extent), grid, supersample=2
    )
    wrong = tuple(zoomed(camera, 1 if n % 3 else -1, fraction) for n, camera in enumerate(rig))
    images = [made.images[name] for name in rig.names]
    found = align_views(replace(rig, cameras=wrong), images, grid).displacement
    assert replace(found, exact_cameras=None).disagrees
    assert found.disagrees == (fraction > 0)


@pytest.mark.parametrize("fraction", [0.0, 0.05])
def test_light_from_outside_the_grid_is_no_error_of_the_cameras(fraction):
    """A flame goes on above the grid: predictions without that light lie off."""
    whole = VoxelGrid((18, 44, 18), 0.5)
    part = VoxelGrid((18, 30, 18), 0.5, (0, -3.5, 0))
    rig = rigs.ring(6, distance=300.0, image_size=(48, 80), footprint=0.27, pitch_degrees=10)
    field = phantoms.create("jet", seed=1, extent=whole.extent)
    made = simulate_images(rig, field, whole, supersample=2)
    wrong = tuple(zoomed(camera, 1 if n % 3 else -1, fraction) for n, camera in enumerate(rig))
    images = [made.images[name] for name in rig.names]
    found = align_views(replace(rig, cameras=wrong), images, part).displacement
    assert replace(found, exact_cameras=None).disagrees
    assert found.disagrees == (fraction > 0)


def test_a_prediction_that_is_too_wide_about_its_own_middle_is_not_displaced():
    """It is magnified about the flame, wherever that stands in the image."""
    rows, columns = np.indices((60, 70), float)
    away = [(rows - row) ** 2 + (columns - column) ** 2 for row, column in PLACES]
    images = [np.exp(-each / (2 * 4.0**2)) for each in away]
    predicted = [np.exp(-each / (2 * 5.0**2)) for each in away]
    found = Displacement.of(predicted, images, [np.ones((60, 70), bool)] * len(PLACES))
    assert not found.disagrees
    assert found.typical < 0.1


def test_dark_views_show_no_displacement():
    dark = [np.zeros((20, 20), np.float32)] * 5
    found = Displacement.of(dark, dark, [np.ones((20, 20), bool)] * 5)
    assert not found.disagrees
    assert found.typical == 0


@pytest.mark.filterwarnings("error")
def test_predictions_without_any_error_agree():
    images = [np.random.default_rng(n).random((20, 20)) for n in range(5)]
    found = Displacement.of(images, images, [np.ones((20, 20), bool)] * 5)
    assert not found.disagrees
    assert found.typical == 0
