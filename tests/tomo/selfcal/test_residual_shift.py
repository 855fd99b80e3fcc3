"""Cameras that are not as the rig says are told of; those that are, are not."""

from dataclasses import replace
from types import SimpleNamespace

import cv2
import numpy as np
import pytest

import phantoms
import rigs
from rigs import Distortion
from tomo.grid import VoxelGrid
from tomo.pipeline.register import prepare
from tomo.selfcal.residual_shift import Displacement
from tomo.selfcal.shifts import align_views
from tomo.simulation import simulate

GRID = VoxelGrid((18, 36, 18), 0.5)
VIEWS = 8


@pytest.fixture(scope="module", params=[0.0, 0.1], ids=["clean", "noisy"])
def case(request):
    rig = rigs.ring(VIEWS, distance=300.0, image_size=(48, 76), footprint=0.27, pitch_degrees=10)
    field = phantoms.create("turbulent", seed=2, extent=GRID.extent)
    made = simulate(rig, field, GRID, supersample=2, refine=2, noise=request.param)
    return SimpleNamespace(rig=rig, images=[made.images[name] for name in rig.names])


def warned(case, change, cameras=range(VIEWS)):
    """Return what is said of a rig of which ``change(camera, sign)`` was made of some cameras."""
    wrong = tuple(
        change(camera, 1 if number % 3 else -1) if number in cameras else camera
        for number, camera in enumerate(case.rig)
    )
    masks = [np.ones(image.shape, bool) for image in case.images]
    found = prepare(
        replace(case.rig, cameras=wrong), case.images, masks, GRID, align=True, carving=None
    )
    return [line for line in found.warnings if "disagree" in line or "beside" in line]


def zoomed(camera, sign, share=0.05):
    matrix = camera.camera_matrix.copy()
    matrix[[0, 1], [0, 1]] *= 1 + sign * share
    return replace(camera, camera_matrix=matrix)


def bent(camera, sign):
    return replace(camera, distortion=Distortion("brown", (-100.0 * sign, 0, 0, 0)))


def turned(camera, sign, pixels=1.2):
    step = sign * pixels / camera.camera_matrix[0, 0]
    turn = cv2.Rodrigues(np.array([0.6, 0.8, 0]) * step)[0]
    return replace(camera, R=turn @ camera.R, t=turn @ camera.t)


@pytest.mark.parametrize("change", [zoomed, bent, turned])
def test_cameras_that_are_off_by_pixels_are_told_of(case, change):
    assert warned(case, change)


def test_the_right_rig_is_not_doubted(case):
    assert warned(case, lambda camera, sign: camera) == []


def test_half_a_pixel_is_nothing_to_doubt_a_rig_for(case):
    assert warned(case, lambda camera, sign: turned(camera, sign, 0.3)) == []


def test_a_single_camera_is_named(case):
    lines = warned(case, lambda camera, sign: zoomed(camera, sign, 0.2), cameras=[5])
    assert len(lines) == 1
    assert "cam05" in lines[0]


def test_a_common_factor_of_all_focal_lengths_is_no_contradiction(case):
    assert warned(case, lambda camera, sign: zoomed(camera, 1, 0.01)) == []


@pytest.mark.parametrize(("pixels", "made"), [(4.0, True), (8.0, False)])
def test_far_shifts_are_made_and_those_too_far_are_told_of(case, pixels, made):
    wrong = tuple(turned(camera, (-1) ** n, pixels) for n, camera in enumerate(case.rig))
    found = align_views(replace(case.rig, cameras=wrong), case.images, GRID)
    assert found.accepted == made
    assert found.displacement.disagrees != found.accepted


@pytest.mark.parametrize("share", [0.0, 0.06])
def test_what_exact_cameras_on_an_arc_would_show_is_allowed(share):
    """Predictions of a smooth jet from few views on one side spread: no fault of the cameras."""
    grid = VoxelGrid((20, 60, 20), 0.5)
    size = {"distance": 300.0, "image_size": (64, 120), "footprint": 0.3}
    rig = rigs.arc(4, span_degrees=90, pitch_degrees=[9.0, -5.0] * 2, **size)
    made = simulate(rig, phantoms.create("jet", seed=2, extent=grid.extent), grid, supersample=2)
    wrong = tuple(zoomed(camera, 1 if n % 3 else -1, share) for n, camera in enumerate(rig))
    images = [made.images[name] for name in rig.names]
    found = align_views(replace(rig, cameras=wrong), images, grid).displacement
    assert replace(found, of_exact=None).disagrees
    assert found.disagrees == (share > 0)


def test_dark_views_say_nothing():
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
