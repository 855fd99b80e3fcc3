"""Cameras that stand out are found, with their causes, from the images of the others alone."""

from dataclasses import replace
from functools import cache
from types import SimpleNamespace

import numpy as np
import pytest

import phantoms
import rigs
from rigs.changes import ImageChange, with_images_changed
from tomo import VoxelGrid
from tomo.measurement import estimate_noise
from tomo.screening import (
    PredictedViews,
    cameras_that_stand_out,
    screen_images,
    single_camera,
)
from tomo.screening.words import advice_on, report_of
from tomo.simulation import simulate_images
from tomo.simulation.effects import Effects

GRID = VoxelGrid((20, 32, 20), 1.0)


@cache
def seen(n_views=12, seed=3, effects=None, name="turbulent", size=(60, 72)):
    rig = rigs.ring(n_views, distance=300.0, image_size=size, footprint=0.5, pitch_degrees=12)
    field = phantoms.create(name, seed=seed, extent=GRID.extent)
    made = simulate_images(rig, field, GRID, supersample=2, effects=effects, seed=seed)
    for image in made.images.values():
        image.setflags(write=False)  # tests share them
    return SimpleNamespace(rig=rig, images=tuple(made.images[n] for n in rig.names))


@pytest.fixture(scope="module", params=[7, 12, 21])
def case(request):
    return seen(request.param)


def found(rig, images):
    masks = [np.isfinite(image) for image in images]
    noise = [estimate_noise(image) for image in images]
    views = PredictedViews.of(rig, images, masks, GRID, noise)
    return cameras_that_stand_out(views, len(rig))


def named(rig, images):
    return {one.name: one.causes[0].words if one.causes else "" for one in found(rig, images)}


def test_honest_views_stay(case):
    assert named(case.rig, case.images) == {}


@pytest.mark.parametrize("what", ["black", "constant", "noise", "another flame"])
def test_a_view_of_something_else_is_named(case, what):
    top = max(image.max() for image in case.images)
    shape = case.images[2].shape
    images = list(case.images)
    images[2] = {
        "black": lambda: np.zeros(shape, np.float32),
        "constant": lambda: np.full(shape, top, np.float32),
        "noise": lambda: (top * np.random.default_rng(0).random(shape)).astype(np.float32),
        "another flame": lambda: seen(len(case.rig), name="jet").images[2],
    }[what]()
    assert list(named(case.rig, images)) == [case.rig.names[2]]


def test_a_view_turned_over_is_named_with_how():
    case = seen(21)
    for turned, words in (
        (case.images[2][:, ::-1], "mirrored"),
        (case.images[2][::-1], "upside down"),
        (case.images[2][::-1, ::-1], "180 degrees"),
    ):
        images = list(case.images)
        images[2] = np.ascontiguousarray(turned)
        found = named(case.rig, images)
        assert list(found) == [case.rig.names[2]]
        assert words in found[case.rig.names[2]]


@pytest.mark.parametrize("degrees", [90, 180, 270])
def test_a_square_image_may_be_turned_and_the_advice_mends_it(degrees):
    """Degrees are clockwise, as ``convert-rig --rotate`` takes them."""
    case = seen(21, size=(72, 72))
    images, name = list(case.images), case.rig.names[4]
    images[4] = np.ascontiguousarray(np.rot90(images[4], -degrees // 90))
    (one,) = found(case.rig, images)
    assert one.name == name
    assert f"turned by {degrees} degrees" in one.causes[0].words
    command = "flametomo convert-rig rig.yaml turned.yaml --rotate "
    assert f"{command}{name}={degrees}," in advice_on(one)
    mended = with_images_changed(case.rig, {name: ImageChange(degrees=degrees)})
    assert found(mended, images) == []


def test_of_two_exchanged_views_both_are_named_with_each_other():
    case = seen(21)
    images = list(case.images)
    images[2], images[9] = images[9], images[2]
    first, second = case.rig.names[2], case.rig.names[9]
    assert named(case.rig, images) == {
        first: f"swapped, it looks like camera {second}'s",
        second: f"swapped, it looks like camera {first}'s",
    }


@pytest.mark.parametrize(
    "effects",
    [
        Effects(absorption=0.03),
        Effects(vignetting=0.4),
        Effects(aperture=20.0, focus_distance=290.0),
    ],
)
def test_what_every_camera_has_is_no_reason(effects):
    for n_views in (7, 12):
        assert named(*vars(seen(n_views, effects=effects)).values()) == {}


def core_before_unlike_cameras(seed):
    """Return cameras of unlike pixels, and what they see of a round core two voxels wide."""
    random = np.random.default_rng(seed)
    ring = rigs.ring(8, distance=300.0, image_size=(48, 60), footprint=0.6, pitch_degrees=12)
    factors = random.uniform(0.5, 1.4, len(ring))
    middle, width = random.uniform(-1.5, 1.5, 3), random.uniform(1.4, 2.0)
    cameras, images = [], []
    for camera, factor in zip(ring, factors, strict=True):
        matrix = camera.camera_matrix.copy()
        matrix[[0, 1], [0, 1]] *= factor
        cameras.append(replace(camera, camera_matrix=matrix))
        columns, rows = camera.image_size
        # two rays along each side of a pixel, each with the integral of a Gaussian
        down, right = np.indices((2 * rows, 2 * columns)) / 2 - 0.25
        origins, ways = cameras[-1].rays(np.stack([right.ravel(), down.ravel()], axis=1))
        away = middle - origins
        along = (away * ways).sum(axis=1, keepdims=True)
        square = np.square(away - along * ways).sum(axis=1)
        light = np.exp(-square / (2 * width**2)).reshape(rows, 2, columns, 2)
        images.append(light.mean(axis=(1, 3)).astype(np.float32))
    return SimpleNamespace(rig=replace(ring, cameras=tuple(cameras)), images=images)


def test_details_finer_than_voxels_are_no_reason(monkeypatch):
    case = core_before_unlike_cameras(1)
    assert named(case.rig, case.images) == {}
    monkeypatch.setattr(single_camera, "EXACT_MARGIN", 0.0)
    assert named(case.rig, case.images)  # else nothing was tested


def test_a_wrong_camera_before_such_details_is_named():
    case = core_before_unlike_cameras(0)
    cameras = list(case.rig)
    cameras[3] = cameras[3].shifted(0.9, -0.6)
    wrong = named(replace(case.rig, cameras=tuple(cameras)), case.images)
    assert list(wrong) == [case.rig.names[3]]
    assert "pointing" in wrong[case.rig.names[3]]


def test_noise_and_cameras_that_look_beside_are_no_reason(case):
    random = np.random.default_rng(1)
    top = max(image.max() for image in case.images)
    noisy = [
        (image + 0.1 * top * random.standard_normal(image.shape)).astype(np.float32)
        for image in case.images
    ]
    assert named(case.rig, noisy) == {}
    cameras = tuple(camera.shifted(*random.uniform(-2, 2, 2)) for camera in case.rig)
    assert named(replace(case.rig, cameras=cameras), case.images) == {}


def test_one_camera_that_looks_beside_is_named_with_its_shift(case):
    cameras = (case.rig[0].shifted(-3, 3), *case.rig[1:])
    (one,) = found(replace(case.rig, cameras=cameras), case.images)
    assert one.name == case.rig.names[0]
    assert one.names("pointing")
    assert one.causes[0].pose[3:] == pytest.approx([3, -3], abs=0.1)


@pytest.mark.parametrize("n_views", [6, 12])
def test_the_ends_of_an_arc_are_no_reason(n_views):
    rig = rigs.arc(n_views, 110.0, distance=300.0, image_size=(60, 72), footprint=0.5)
    field = phantoms.create("turbulent", seed=3, extent=GRID.extent)
    made = simulate_images(rig, field, GRID, supersample=2)
    assert named(rig, [made.images[name] for name in rig.names]) == {}


def test_few_views_and_dark_ones_are_not_judged():
    case = seen(4)
    masks = [np.isfinite(image) for image in case.images]
    assert screen_images(case.rig, case.images, masks, GRID).cameras == ()
    case = seen(7)
    dark = [np.zeros_like(image) for image in case.images]
    assert screen_images(case.rig, dark, [np.isfinite(i) for i in dark], GRID).cameras == ()


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("shape", [(1, 1, 1), (4, 4, 4)])
def test_so_few_pixels_that_nothing_can_be_said_are_no_reason(shape):
    rig = rigs.ring(7, distance=300.0, image_size=(6, 6), footprint=0.5)
    images = [np.random.default_rng(n).random((6, 6), np.float32) for n in range(7)]
    masks = [np.isfinite(image) for image in images]
    assert screen_images(rig, images, masks, VoxelGrid(shape, 1.0)).cameras == ()


def test_a_camera_that_sees_nothing_of_it_is_not_judged():
    case = seen(12)
    away = case.rig[3].transformed(np.diag([1.0, 1.0, 1.0]), [0.0, 500.0, 0.0])
    rig = replace(case.rig, cameras=(*case.rig[:3], away, *case.rig[4:]))
    assert named(rig, case.images) == {}


def test_where_most_contradict_each_other_none_is_left_out():
    case = seen(9)
    random = np.random.default_rng(0)
    images = [random.random(image.shape).astype(np.float32) for image in case.images]
    images[:2] = case.images[:2]
    assert named(case.rig, images) == {}


def test_a_held_out_view_is_tested_and_tests_no_other():
    case = seen(12)
    images = list(case.images)
    images[11] = np.ascontiguousarray(images[11][::-1])
    masks = [np.isfinite(image) for image in images]
    training = replace(case.rig, cameras=case.rig.cameras[:11])
    beside = (replace(case.rig, cameras=case.rig.cameras[11:]), images[11:], masks[11:])
    found = screen_images(training, images[:11], masks[:11], GRID, held_out=beside)
    assert found.excluded == ()
    assert [one.name for one in found.cameras] == [case.rig.names[11]]
    assert found.warnings[0].startswith(f"camera {case.rig.names[11]}: ")
    assert "held out" in found.warnings[0]


def test_outlier_pixels_do_not_make_a_held_out_view_inconsistent():
    case = seen(12)
    images, masks = list(case.images), [np.isfinite(image) for image in case.images]
    outliers = np.random.default_rng(0).random(images[11].shape) < 0.01
    images[11] = np.where(outliers, 30 * images[11].max(), images[11]).astype(np.float32)
    training = replace(case.rig, cameras=case.rig.cameras[:11])
    beside = (replace(case.rig, cameras=case.rig.cameras[11:]), images[11:], masks[11:])
    found = screen_images(training, images[:11], masks[:11], GRID, held_out=beside)
    assert found.cameras == ()
    assert found.outliers[case.rig.names[11]] > 0.9 * np.count_nonzero(outliers)


def test_the_same_bits_again(case):
    images = [*case.images[:-1], case.images[-1][::-1]]
    first, again = (found(case.rig, images) for _ in range(2))
    assert [one.name for one in first] == [case.rig.names[-1]]
    assert [report_of(one) for one in first] == [report_of(one) for one in again]
