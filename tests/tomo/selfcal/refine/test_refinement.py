from dataclasses import replace

import numpy as np
import pytest

import phantoms
import rigs
from rigs import box_points, ray_miss
from tomo import VoxelGrid
from tomo.selfcal.refine import refine_cameras
from tomo.selfcal.refine.parameters import COUNT, moved_rig
from tomo.selfcal.refine.prior import units
from tomo.simulation import simulate_images

GRID = VoxelGrid((16, 40, 16), 0.8)
FOOTPRINT = 0.6
POINTS = box_points(GRID.lower, GRID.upper, 5)


def disturbed(rig, seed, pixels=0.35):
    """Return the rig with random errors of position and rotation, each of ``pixels`` pixels."""
    random = np.random.default_rng(seed)
    steps = np.zeros((len(rig), COUNT))
    for index, camera in enumerate(rig):
        steps[index, :6] = random.normal(size=6) * pixels * units(camera, GRID)[:6]
    return moved_rig(rig, steps)


def seen(seed):
    """Return twelve cameras and their images of a flame with 2 % noise, from finer voxels."""
    rig = rigs.ring(
        12, distance=400, image_size=(40, 64), footprint=FOOTPRINT, pitch_degrees=[12, -12] * 6
    )
    flame = phantoms.create("turbulent", extent=GRID.extent, seed=seed)
    scan = simulate_images(rig, flame, GRID, supersample=3, refine=2, noise=0.02, seed=seed)
    return rig, list(scan.images.values())


@pytest.fixture(scope="module")
def scene():
    return seen(5)


@pytest.fixture(scope="module")
def found(scene):
    rig, images = scene
    return refine_cameras(disturbed(rig, 3), images, GRID)


def test_half_a_pixel_of_pose_errors_is_found(scene, found):
    rig, _ = scene
    before = ray_miss(rig, found.given, POINTS) / FOOTPRINT
    after = ray_miss(rig, found.rig, POINTS) / FOOTPRINT
    assert before > 0.4
    assert after < 0.1
    assert found.accepted
    assert found.error_after < found.error_before


def test_the_report_is_plain_and_complete(found):
    import json

    report = json.loads(json.dumps(found.report()))
    assert report["accepted"] is True
    assert list(report["cameras"]) == list(found.given.names)
    for own in report["cameras"].values():
        assert own["prior_pixels"] == 2.0
        assert 0 < own["moved_pixels"] < 5


def test_the_same_bits_for_any_number_of_threads(scene, found, on_threads):
    rig, images = scene
    with on_threads(1):
        again = refine_cameras(disturbed(rig, 3), images, GRID)
    assert np.array_equal(again.parameters, found.parameters)


@pytest.mark.parametrize("seed", [5, 8])
def test_exact_cameras_are_left_as_they_are(seed):
    rig, images = seen(seed)
    found = refine_cameras(rig, images, GRID)
    assert not found.accepted
    assert found.rig is rig


def test_only_the_chosen_cameras_move_and_their_gains_are_found(scene):
    rig, images = scene
    bad = disturbed(rig, 4, pixels=1.0)
    mixed = replace(rig, cameras=(*rig.cameras[:3], bad[3], *rig.cameras[4:]))
    dimmed = [0.8 * image if view == 3 else image for view, image in enumerate(images)]
    found = refine_cameras(mixed, dimmed, GRID, cameras=["cam03"])
    assert found.accepted
    assert all(found.rig[view] == mixed[view] for view in range(12) if view != 3)
    assert found.report()["cameras"]["cam03"]["gain"] == pytest.approx(0.8, abs=0.04)
    assert ray_miss(rig, found.rig, POINTS) < 0.3 * ray_miss(rig, mixed, POINTS)


def test_a_focal_length_that_is_nominal_is_found(scene):
    rig, images = scene
    step = np.zeros((12, COUNT))
    step[5, 6] = 0.05
    wrong = moved_rig(rig, step)
    cameras = [replace(c, status="nominal") if c.name == "cam05" else c for c in wrong]
    found = refine_cameras(replace(wrong, cameras=tuple(cameras)), images, GRID, cameras=["cam05"])
    assert found.prior_pixels[5] == 10.0
    assert found.parameters[5, 6] == pytest.approx(-0.05, abs=0.01)


def test_a_short_prior_holds_the_cameras(scene):
    rig, images = scene
    found = refine_cameras(disturbed(rig, 3), images, GRID, prior_pixels=1e-3)
    assert found.moved_pixels.max() < 0.05


def test_held_out_rays_take_no_part_in_the_refinement(scene, monkeypatch):
    """Held-out pixels change the held-out error and leave the cameras the same."""
    from tomo.selfcal.refine import search
    from tomo.selfcal.refine.held_out import held_out_tiles

    monkeypatch.setattr(search, "ROUNDS", 1)
    rig, images = scene
    held = held_out_tiles([image.shape for image in images])
    changed = [np.where(own, 0.97 * i, i) for own, i in zip(held, images, strict=True)]
    again = refine_cameras(disturbed(rig, 3), changed, GRID, skip=False)
    clean = refine_cameras(disturbed(rig, 3), images, GRID, skip=False)
    assert clean.parameters.any()
    assert np.array_equal(again.parameters, clean.parameters)
    assert again.error_before != clean.error_before


def test_dark_images_and_a_volume_out_of_sight_change_nothing(scene):
    rig, images = scene
    dark = refine_cameras(rig, [0 * image for image in images], GRID)
    assert not dark.accepted
    assert "dark" in dark.reason
    away = VoxelGrid((8, 8, 8), 0.8, center=(1e4, 0, 0))
    unseen = refine_cameras(rig, images, away)
    assert not unseen.accepted
    assert unseen.rig is rig


def test_a_camera_that_sees_nothing_stays_where_it_is(scene):
    rig, images = scene
    away = replace(rig[2], t=rig[2].t + np.array([500, 0, 0]))
    mixed = replace(rig, cameras=(*rig.cameras[:2], away, *rig.cameras[3:]))
    blank = [np.zeros_like(image) if view == 2 else image for view, image in enumerate(images)]
    found = refine_cameras(mixed, blank, GRID, cameras=["cam02", "cam03"])
    assert np.abs(found.parameters[2]).max() == 0
    assert np.isfinite(found.parameters).all()


def test_masked_pixels_change_nothing(scene):
    rig, images = scene
    random = np.random.default_rng(1)
    masks = [random.random(image.shape) > 0.02 for image in images]
    changed = [np.where(m, i, 1e6).astype(np.float32) for i, m in zip(images, masks, strict=True)]
    bad = disturbed(rig, 3)
    names = ["cam00", "cam07"]
    one, other = (
        refine_cameras(bad, some, GRID, cameras=names, masks=masks) for some in (images, changed)
    )
    assert np.array_equal(one.parameters, other.parameters)


@pytest.mark.parametrize(
    ("cameras", "views", "prior", "words"),
    [
        (["cam99"], 12, None, "found camera 'cam99', expected one of cam00"),
        ([], 12, None, "found no camera"),
        (None, 2, None, "found 2 views to refine with, expected at least 3"),
        (None, 12, 0.0, "prior_pixels: found 0.0, expected pixels above 0"),
    ],
)
def test_bad_requests_are_refused_in_one_line(scene, cameras, views, prior, words):
    rig, images = scene
    with pytest.raises(ValueError, match=words) as error:
        refine_cameras(rig[:views], images[:views], GRID, cameras=cameras, prior_pixels=prior)
    assert "\n" not in str(error.value)


def test_tables_of_rays_and_missing_images_are_refused(scene):
    rig, images = scene
    table = rigs.RayTable.of(rig[0])
    mixed = replace(rig, cameras=(table, *rig.cameras[1:]))
    with pytest.raises(ValueError, match="camera cam00: found a table of rays"):
        refine_cameras(mixed, images, GRID)
    with pytest.raises(ValueError, match="images: found 11"):
        refine_cameras(rig, images[:11], GRID)


@pytest.mark.parametrize("what", ["images", "masks"])
def test_sizes_that_do_not_fit_the_cameras_are_refused_in_one_line(scene, what):
    rig, images = scene
    given = {"images": images, "masks": [np.ones(image.shape, bool) for image in images]}
    given[what] = [given[what][0][:-2], *given[what][1:]]
    words = rf"{what}: camera cam00: found shape \(62, 40\), expected \(64, 40\)"
    with pytest.raises(ValueError, match=words) as error:
        refine_cameras(rig, given["images"], GRID, masks=given["masks"])
    assert "\n" not in str(error.value)
