"""Cameras of a film that its own frames put right."""

from dataclasses import replace

import numpy as np
import pytest

import phantoms
import rigs
from rigs import box_points, ray_miss
from tomo import Options, Scan, VoxelGrid
from tomo.metrics import nrmse
from tomo.selfcal.refine.parameters import COUNT, moved_rig
from tomo.selfcal.refine.prior import units
from tomo.series.images import reader_of
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
    align=False,
)


@pytest.fixture(scope="module")
def film():
    """Return the true rig, one whose poses are half a pixel wrong, and images of both."""
    rig = rigs.ring(
        6, distance=300, image_size=(24, 32), footprint=0.8, pitch_degrees=[12, -12] * 3
    )
    made = []
    for seed in range(FRAMES):
        flame = phantoms.create("turbulent", extent=GRID.extent, seed=seed)
        made.append(simulate_images(rig, flame, GRID, refine=1, noise=0.02, seed=seed))
    images = {name: np.array([one.images[name] for one in made]) for name in rig.names}
    random = np.random.default_rng(2)
    steps = np.zeros((len(rig), COUNT))
    for number, camera in enumerate(rig):
        if camera.name != HELD_OUT:
            steps[number, :6] = random.normal(size=6) * 0.4 * units(camera, GRID)[:6]
    return rig, moved_rig(rig, steps), images, [one.truth for one in made]


def planned(rig, images, **asked):
    scan = Scan.from_arrays(rig, images, GRID)
    return make_plan(scan, GRID, replace(OPTIONS, **asked), tuple(range(FRAMES)))


def error_of(plan, truths):
    read = reader_of(plan.scan, plan.screened)
    block = range(2)
    found = solve_block(plan, block, [read(place) for place in block])
    return np.mean([nrmse(result.volume, truths[place]) for place, result in found])


@pytest.fixture(scope="module")
def plan(film):
    _, wrong, images, _ = film
    return planned(wrong, images)


def test_a_film_puts_its_cameras_right_without_being_asked(film, plan):
    rig, wrong, images, truths = film
    missed = [ray_miss(rig.without(HELD_OUT), one, POINTS)
              for one in (wrong.without(HELD_OUT), plan.registered.rig)]  # fmt: skip
    assert missed[1] < 0.4 * missed[0]
    assert error_of(plan, truths) < 0.9 * error_of(
        planned(wrong, images, refine_cameras="none"), truths
    )
    assert plan.report()["refinement"]["accepted"] is True
    line = next(one for one in plan.warnings if one.startswith("cameras refined"))
    assert "from 4 frames together: cam00, cam01, cam03" in line
    assert "--refine-cameras none" in line
    found = attributes_of_plan(plan)["corrected_rig"]
    assert [camera["name"] for camera in found["cameras"]] == list(rig.names)
    assert found["calibration"]["refined_from_images"]["accepted"] is True


def test_exact_cameras_lose_nothing(film):
    rig, _, images, truths = film
    by_default, as_given = planned(rig, images), planned(rig, images, refine_cameras="none")
    assert as_given.registered.refinement is None
    assert error_of(by_default, truths) < 1.01 * error_of(as_given, truths)


def test_the_view_held_out_moves_no_camera(film, plan):
    _, wrong, images, _ = film
    noise = np.random.default_rng(1).uniform(0, 3, images[HELD_OUT].shape)
    other = planned(wrong, {**images, HELD_OUT: noise})
    found, again = plan.registered, other.registered
    assert np.array_equal(found.refinement.parameters, again.refinement.parameters)
    assert again.rig == found.rig


def test_few_frames_and_none_leave_the_rig_as_it_is(film):
    _, wrong, images, _ = film
    short = {name: each[:3] for name, each in images.items()}
    plan = make_plan(Scan.from_arrays(wrong, short, GRID), GRID, OPTIONS, (0, 1, 2))
    assert plan.registered.refinement is None
    asked = replace(OPTIONS, refine_cameras=f"cam00,cam01,{HELD_OUT}", refine_frames=2)
    plan = make_plan(Scan.from_arrays(wrong, short, GRID), GRID, asked, (0, 1, 2))
    assert plan.registered.refinement.cameras == ("cam00", "cam01")
    assert np.allclose(plan.registered.rig["cam03"].R, wrong["cam03"].R)
