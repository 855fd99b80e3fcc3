"""Pointing errors of cameras are found as shifts of images; exact cameras get no shift."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

import phantoms
import rigs
from tomo.grid import VoxelGrid
from tomo.metrics import cosine_distance
from tomo.operators import LinearSystem
from tomo.selfcal.left_out_views import shifted
from tomo.selfcal.shifts import align_views
from tomo.simulation import simulate_images
from tomo.solvers import nnls


def _case(n_views, name="turbulent"):
    grid = VoxelGrid((24, 36, 24), 1.0)
    rig = rigs.ring(n_views, distance=300.0, image_size=(72, 84), footprint=0.5, pitch_degrees=12)
    field = phantoms.create(name, seed=3, extent=grid.extent)
    made = simulate_images(rig, field, grid, supersample=2, refine=2)
    images = [made.images[camera] for camera in rig.names]
    return SimpleNamespace(rig=rig, grid=grid, images=images, truth=made.truth)


@pytest.fixture(scope="module", params=[5, 12])
def case(request):
    return _case(request.param)


def _wrong_rig(case, spread, seed=0):
    """Return a rig with pointing errors, and the resulting shifts of its images."""
    shifts = np.random.default_rng(seed).normal(0, spread, (len(case.rig), 2))
    return shifted(case.rig, -shifts), shifts


def test_wrong_principal_points_are_found_but_for_a_motion_of_the_volume(case):
    wrong, shifts = _wrong_rig(case, 2.0)
    found = align_views(wrong, case.images, case.grid)
    assert found.accepted
    assert found.error_after < found.error_before
    report = found.report(wrong.names)
    assert report["shifts"] == dict(zip(wrong.names, found.shifts.tolist(), strict=True))
    assert list(report["displacement"]["pixels"]) == list(wrong.names)
    # Three motions of the world shift the images too: compare the shifts without them.
    left = shifts - found.shifts
    motions = np.concatenate(
        [
            (camera.project(np.eye(3))[0] - camera.project(np.zeros((1, 3)))[0]).T
            for camera in case.rig
        ]
    )
    motion = np.linalg.lstsq(motions, left.ravel(), rcond=None)[0]
    left = left - (motions @ motion).reshape(left.shape)
    assert np.sqrt(np.mean(left**2)) < 0.35 * 2.0


def test_the_aligned_rig_gives_the_better_volume():
    case = _case(12)
    wrong, _ = _wrong_rig(case, 2.0)
    found = align_views(wrong, case.images, case.grid)
    distances = []
    for rig in (wrong, found.rig(wrong)):
        system = LinearSystem.from_rig(rig, case.grid)
        volume = nnls(system.projector, system.flatten(case.images), iterations=12).volume
        # The volume may have moved with the cameras: the residual is blind to that.
        seen = system.projector @ volume.ravel()
        distances.append(cosine_distance(seen, system.flatten(case.images)))
    assert distances[1] < 0.5 * distances[0]


@pytest.mark.parametrize("noise", [0.0, 0.1])
def test_good_cameras_stay_as_they_are(case, noise):
    random = np.random.default_rng(1)
    peak = max(image.max() for image in case.images)
    images = [
        (image + noise * peak * random.standard_normal(image.shape)).astype(np.float32)
        for image in case.images
    ]
    found = align_views(case.rig, images, case.grid)
    assert not found.accepted
    assert found.rig(case.rig) == case.rig
    assert found.shifts.tolist() == np.zeros((len(case.rig), 2)).tolist()


def test_brighter_cameras_are_notshifted():
    case = _case(5)
    images = [image * gain for image, gain in zip(case.images, (1, 1.3, 0.8, 1, 1.1), strict=True)]
    assert not align_views(case.rig, images, case.grid).accepted


def test_unusable_pixels_do_not_count():
    case = _case(5)
    wrong, _ = _wrong_rig(case, 2.0)
    masks = [np.ones(image.shape, bool) for image in case.images]
    broken = [image.copy() for image in case.images]
    for mask, image in zip(masks, broken, strict=True):
        mask[30:32, 20:24] = False
        image[30:32, 20:24] = np.nan
    good = align_views(wrong, case.images, case.grid, masks=masks)
    found = align_views(wrong, broken, case.grid, masks=masks)
    np.testing.assert_array_equal(found.shifts, good.shifts)


def test_the_reason_names_missing_views_and_dark_images():
    case = _case(5)
    two = replace(case.rig, cameras=tuple(case.rig)[:2])
    assert "too few" in align_views(two, case.images[:2], case.grid).reason
    dark = [np.zeros_like(image) for image in case.images]
    assert "dark" in align_views(case.rig, dark, case.grid).reason
    with pytest.raises(ValueError, match="images: found 4, expected one for each of 5"):
        align_views(case.rig, case.images[:4], case.grid)
