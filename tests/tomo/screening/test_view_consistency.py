"""Inconsistent views are found by the predictions from the others alone."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

import phantoms
import rigs
from tomo import VoxelGrid
from tomo.screening import check_consistency, screen_images
from tomo.screening.agreement import agreement
from tomo.screening.left_out_prediction import subsets_of
from tomo.simulation import simulate_images
from tomo.simulation.effects import Effects

GRID = VoxelGrid((20, 32, 20), 1.0)


def seen(n_views=12, seed=3, effects=None, name="turbulent", size=(60, 72)):
    rig = rigs.ring(n_views, distance=300.0, image_size=size, footprint=0.5, pitch_degrees=12)
    field = phantoms.create(name, seed=seed, extent=GRID.extent)
    made = simulate_images(rig, field, GRID, supersample=2, effects=effects, seed=seed)
    return SimpleNamespace(rig=rig, images=[made.images[n] for n in rig.names])


@pytest.fixture(scope="module", params=[7, 12, 21])
def case(request):
    return seen(request.param)


def named(rig, images):
    masks = [np.isfinite(image) for image in images]
    return {v.name: v.looks for v in check_consistency(rig, images, masks, GRID) if v.inconsistent}


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


def test_a_square_image_may_be_turned_by_90_degrees():
    case = seen(21, size=(72, 72))
    images = list(case.images)
    images[4] = np.ascontiguousarray(np.rot90(images[4]))
    found = named(case.rig, images)
    assert list(found) == [case.rig.names[4]]
    assert "270 degrees" in found[case.rig.names[4]]  # what puts it right


def test_of_two_exchanged_views_both_are_named_with_each_other():
    case = seen(21)
    images = list(case.images)
    images[2], images[9] = images[9], images[2]
    first, second = case.rig.names[2], case.rig.names[9]
    assert named(case.rig, images) == {
        first: f"looks like camera {second}'s",
        second: f"looks like camera {first}'s",
    }


@pytest.mark.parametrize(
    "effects",
    [
        Effects(gain_spread=0.1),
        Effects(absorption=0.03),
        Effects(vignetting=0.4),
        Effects(aperture=20.0, focus_distance=290.0),
    ],
)
def test_what_every_camera_has_is_no_reason(effects):
    for n_views in (7, 12):
        assert named(*vars(seen(n_views, effects=effects)).values()) == {}


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
    cameras = (case.rig[0].shifted(3, -3), *case.rig[1:])
    assert named(replace(case.rig, cameras=cameras), case.images) == {}


@pytest.mark.parametrize("n_views", [6, 12])
def test_the_ends_of_an_arc_are_no_reason(n_views):
    rig = rigs.arc(n_views, 110.0, distance=300.0, image_size=(60, 72), footprint=0.5)
    field = phantoms.create("turbulent", seed=3, extent=GRID.extent)
    made = simulate_images(rig, field, GRID, supersample=2)
    assert named(rig, [made.images[name] for name in rig.names]) == {}


def test_few_views_and_dark_ones_are_not_judged():
    case = seen(4)
    masks = [np.isfinite(image) for image in case.images]
    assert check_consistency(case.rig, case.images, masks, GRID) == ()
    case = seen(7)
    dark = [np.zeros_like(image) for image in case.images]
    assert check_consistency(case.rig, dark, [np.isfinite(i) for i in dark], GRID) == ()


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("shape", [(1, 1, 1), (4, 4, 4)])
def test_so_few_pixels_that_nothing_can_be_said_are_no_reason(shape):
    rig = rigs.ring(7, distance=300.0, image_size=(6, 6), footprint=0.5)
    images = [np.random.default_rng(n).random((6, 6), np.float32) for n in range(7)]
    masks = [np.isfinite(image) for image in images]
    found = check_consistency(rig, images, masks, VoxelGrid(shape, 1.0))
    assert not any(view.inconsistent for view in found)


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
    assert [view.name for view in found.views if view.inconsistent] == [case.rig.names[11]]
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
    assert not any(view.inconsistent for view in found.views)
    assert found.outliers[case.rig.names[11]] > 0.9 * np.count_nonzero(outliers)


def test_the_same_bits_again(case):
    masks = [np.isfinite(image) for image in case.images]
    first, again = (check_consistency(case.rig, case.images, masks, GRID) for _ in range(2))
    assert first == again


@pytest.mark.parametrize("n_views", [5, 6, 7, 11, 12, 19, 20, 33])
def test_a_wrong_view_leaves_every_other_a_party_without_both(n_views):
    subsets = subsets_of(n_views)
    for view in range(n_views):
        for wrong in set(range(n_views)) - {view}:
            assert any(view not in subset and wrong not in subset for subset in subsets)


def test_agreement_knows_neither_gain_nor_offset_nor_a_small_shift():
    random = np.random.default_rng(0)
    image = random.random((20, 30))
    mask = np.ones(image.shape, bool)
    assert agreement([image], 3 * image + 7, mask, 0) == pytest.approx(1)
    assert agreement([image], -image, mask, 0) == pytest.approx(-1)
    moved = np.roll(image, (1, -2), (0, 1))
    assert agreement([image], moved, mask, 0) < 0.5
    assert agreement([image], moved, mask, 2) == pytest.approx(1)
    assert agreement([image], np.ones_like(image), mask, 1) == 0
    assert np.isnan(agreement([image], image, np.zeros_like(mask), 1))


@pytest.mark.parametrize("shape", [(1, 80), (2, 80), (80, 2)])
def test_agreement_of_images_narrower_than_the_shifts_that_are_tried(shape):
    image = np.random.default_rng(0).random(shape)
    mask = np.ones(shape, bool)
    assert agreement([image], image, mask, 3) == pytest.approx(1)
    along = int(np.argmax(shape))
    assert agreement([image], np.roll(image, 2, along), mask, 3) == pytest.approx(1)
