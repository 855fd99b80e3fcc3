"""Cameras refined from several moments together, and judged by others."""

from types import SimpleNamespace

import numpy as np
import pytest

import phantoms
import rigs
from rigs import box_points, ray_miss
from tomo import VoxelGrid
from tomo.selfcal.refine import Moment, refine_cameras, refine_over_moments
from tomo.selfcal.refine.parameters import COUNT, moved_rig
from tomo.selfcal.refine.prior import units
from tomo.simulation import simulate_images

GRID = VoxelGrid((12, 24, 12), 1.0)
FOOTPRINT = 0.8
POINTS = box_points(GRID.lower, GRID.upper, 4)


@pytest.fixture(scope="module")
def film():
    """Return six cameras, six moments of unrelated flames, and a rig half a pixel wrong."""
    rig = rigs.ring(
        6, distance=300, image_size=(32, 48), footprint=FOOTPRINT, pitch_degrees=[12, -12] * 3
    )
    moments = []
    for seed in range(6):
        flame = phantoms.create("turbulent", extent=GRID.extent, seed=seed)
        scan = simulate_images(rig, flame, GRID, supersample=2, refine=2, noise=0.02, seed=seed)
        moments.append(Moment.of(list(scan.images.values())))
    random = np.random.default_rng(4)
    steps = np.zeros((len(rig), COUNT))
    for index, camera in enumerate(rig):
        steps[index, :6] = random.normal(size=6) * 0.4 * units(camera, GRID)[:6]
    return SimpleNamespace(rig=rig, moments=moments, wrong=moved_rig(rig, steps))


@pytest.fixture(scope="module")
def found(film):
    return refine_over_moments(film.wrong, film.moments[:3], GRID, judges=film.moments[3:])


def missed(film, rig):
    return ray_miss(film.rig, rig, POINTS) / FOOTPRINT


def test_many_moments_find_cameras_better_than_one(film, found):
    one = refine_cameras(film.wrong, film.moments[0].images, GRID)
    assert found.accepted
    assert missed(film, found.rig) < 0.7 * missed(film, one.rig)
    assert missed(film, found.rig) < 0.3 * missed(film, film.wrong)


def test_exact_cameras_stay(film):
    exact = refine_over_moments(film.rig, film.moments[:3], GRID, judges=film.moments[3:])
    assert missed(film, exact.rig) < 0.05


def test_other_moments_judge_and_move_nothing(film, found):
    """Judged by noise, nothing is accepted; the cameras found are those of the moments alone."""
    random = np.random.default_rng(0)
    noise = [Moment.of([random.random(i.shape) for i in film.moments[0].images])]
    judged = refine_over_moments(film.wrong, film.moments[:3], GRID, judges=noise, skip=False)
    assert not judged.accepted
    assert judged.rig is film.wrong


def test_dark_moments_say_nothing(film, found):
    dark = Moment.of([np.zeros_like(image) for image in film.moments[0].images])
    moments, judges = [dark, *film.moments[:3]], [*film.moments[3:], dark]
    again = refine_over_moments(film.wrong, moments, GRID, judges=judges)
    assert np.array_equal(again.parameters, found.parameters)
    unchanged = refine_over_moments(film.wrong, [dark], GRID, judges=judges)
    assert unchanged.rig is film.wrong
    assert "dark" in unchanged.reason


def test_pixels_that_one_moment_lacks_count_at_none(film):
    moments = list(film.moments[:3])
    masks = [mask.copy() for mask in moments[1].masks]
    masks[2][10:14, 10:14] = False
    images = [np.where(m, i, 1e3) for i, m in zip(moments[1].images, masks, strict=True)]
    moments[1] = Moment.of(images, masks)
    again = refine_over_moments(film.wrong, moments, GRID, judges=film.moments[3:])
    assert missed(film, again.rig) < 0.3 * missed(film, film.wrong)
