"""Cameras of a film that its own frames put right."""

from dataclasses import replace

import numpy as np
import pytest

import phantoms
import rigs
from rigs import box_points, ray_miss
from tomo import Options, Scan, VoxelGrid
from tomo.metrics import nrmse
from tomo.series.frames import reader_of
from tomo.series.run import solve_block
from tomo.series.same_run import attributes_of_plan
from tomo.series.settle import make_plan
from tomo.simulation import simulate_images

FRAMES = 8
GRID = VoxelGrid((10, 16, 10), 1.0)
POINTS = box_points(GRID.lower, GRID.upper, 4)
HELD_OUT = "cam02"
OPTIONS = Options(
    frames=":",
    hold_out=(HELD_OUT,),
    key_frames=2,
    method="mlem",
    iterations=20,
    basis="voxel",
    screen=False,
    fit_absorption=False,
)


@pytest.fixture(scope="module")
def film(disturbed):
    """Return the true rig, one whose poses are half a pixel wrong, and images of both."""
    rig = rigs.ring(
        6, distance=300, image_size=(24, 32), footprint=0.8, pitch_degrees=[12, -12] * 3
    )
    made = []
    for seed in range(FRAMES):
        flame = phantoms.create("turbulent", extent=GRID.extent, seed=seed)
        made.append(simulate_images(rig, flame, GRID, refine=1, noise=0.02, seed=seed))
    images = {name: np.array([one.images[name] for one in made]) for name in rig.names}
    return rig, disturbed(rig, GRID, 2, 0.4, but=HELD_OUT), images, [one.truth for one in made]


def planned(rig, images, **asked):
    scan = Scan.from_arrays(rig, images, GRID)
    return make_plan(scan, GRID, replace(OPTIONS, **asked), tuple(range(FRAMES)))


def error_of(plan, truths):
    read = reader_of(plan.scan, plan.screened)
    block = range(2)
    found = solve_block(plan, block, [read(place) for place in block])
    return np.mean([nrmse(result.volume, truths[place]) for place, result in found])


def missed(rig, wrong, plan):
    """Return by how much lines of sight miss each other, before and after."""
    both = wrong.without(HELD_OUT), plan.registered.rig
    return [ray_miss(rig.without(HELD_OUT), one, POINTS) for one in both]


@pytest.fixture(scope="module")
def plan(film):
    _, wrong, images, _ = film
    return planned(wrong, images)


@pytest.fixture(scope="module")
def asked(film):
    _, wrong, images, _ = film
    return planned(wrong, images, refine_cameras="all,none")


@pytest.fixture(scope="module")
def error_as_given(film):
    """Return the error with the wrong poses."""
    _, wrong, images, truths = film
    return error_of(planned(wrong, images, refine_cameras="none"), truths)


@pytest.mark.parametrize("how", ["plan", "asked"])
def test_a_film_puts_its_cameras_right(film, error_as_given, how, request):
    rig, wrong, _, truths = film
    plan = request.getfixturevalue(how)
    before, after = missed(rig, wrong, plan)
    assert after < 0.25 * before
    assert error_of(plan, truths) < 0.9 * error_as_given
    assert plan.report()["refinement"]["accepted"] is True
    found = attributes_of_plan(plan)["corrected_rig"]
    assert [camera["name"] for camera in found["cameras"]] == list(rig.names)
    assert found["calibration"]["refined_from_images"]["accepted"] is True


def test_it_says_what_was_asked_for_and_what_was_found(plan, asked):
    line = next(one for one in asked.warnings if one.startswith("cameras refined"))
    assert "from 2 frames together: cam00, cam01, cam03" in line
    assert "the store's corrected_rig" in line
    assert not any(one.startswith("cameras refined") for one in plan.warnings)
    assert {one.effect for one in plan.screened.findings} == {"pose"}
    assert asked.screened.findings == ()


def test_exact_cameras_lose_nothing(film):
    rig, _, images, truths = film
    as_given, *found = (
        planned(rig, images, refine_cameras=cameras) for cameras in ("none", None, "all")
    )
    assert as_given.screened.refinement is None
    for plan in found:
        assert error_of(plan, truths) < 1.01 * error_of(as_given, truths)


def test_only_cameras_that_are_named_are_refined_and_the_view_held_out_moves_none(film):
    _, wrong, images, _ = film
    short = {name: each[:2] for name, each in images.items()}
    noise = np.random.default_rng(1).uniform(0, 3, short[HELD_OUT].shape)
    options = replace(OPTIONS, refine_cameras=f"cam00,cam01,{HELD_OUT},none", key_frames=1)
    plan, other = (
        make_plan(Scan.from_arrays(wrong, seen, GRID), GRID, options, (0, 1))
        for seen in (short, {**short, HELD_OUT: noise})
    )
    assert plan.screened.refinement.cameras == ("cam00", "cam01")
    assert plan.registered.rig["cam00"] != wrong["cam00"]
    assert plan.registered.rig["cam03"] == wrong["cam03"]
    assert other.registered.rig == plan.registered.rig
