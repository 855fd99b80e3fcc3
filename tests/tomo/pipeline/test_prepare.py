"""From frames to weighted equations: a still is a film of one frame, frames share effects."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

import phantoms
import rigs
from tomo import Options, Scan, VoxelGrid
from tomo.pipeline.load import load
from tomo.pipeline.prepare import prepare
from tomo.simulation import simulate_images

pytestmark = pytest.mark.usefixtures("quick_solves")

GRID = VoxelGrid((12, 18, 12), 1.0)
WRONG, SHIFT = "cam03", (1.5, -1.0)
HELD_OUT = "cam05"
OPTIONS = Options(hold_out=(HELD_OUT,), fit_absorption=False)
FRAMES = 2


@pytest.fixture(scope="module")
def rig():
    return rigs.ring(
        7, distance=300, image_size=(27, 36), footprint=0.8, pitch_degrees=[12, -14, 9] * 2 + [3]
    )


@pytest.fixture(scope="module")
def film(rig):
    """Return two moments of a flame: images by camera, and the emission."""
    made = []
    for seed in range(FRAMES):
        flame = phantoms.create("turbulent", extent=GRID.extent, seed=seed)
        made.append(simulate_images(rig, flame, GRID, refine=2, noise=0.01, seed=seed))
    images = {name: np.array([one.images[name] for one in made]) for name in rig.names}
    return SimpleNamespace(images=images, truths=[one.truth for one in made])


def prepared(rig, images, count, options=OPTIONS):
    scan = Scan.from_arrays(rig, images, GRID)
    loaded = [load(scan, frame.name) for frame in scan.frames[:count]]
    return prepare(scan, GRID, options, loaded)


@pytest.fixture(scope="module")
def shifted(rig):
    cameras = (one.shifted(*SHIFT) if one.name == WRONG else one for one in rig)
    return replace(rig, cameras=tuple(cameras))


@pytest.mark.parametrize("count", [1, FRAMES])
def test_a_wrong_camera_is_found_in_a_still_and_in_a_film(rig, shifted, film, count):
    found = prepared(shifted, film.images, count)
    assert [one.camera for one in found.screened.findings if one.effect == "pose"] == [WRONG]
    middle = np.array([GRID.center])
    here, there, given = (
        one[WRONG].project(middle)[0] for one in (found.registered.rig, rig, shifted)
    )
    assert np.linalg.norm(here - there) < 0.2 * np.linalg.norm(given - there)
    assert len(found.frames) == count
    assert found.apart.rig.names == (HELD_OUT,)


def test_a_film_of_one_frame_is_a_still(rig, film, as_given):
    still = {name: each[0] for name, each in film.images.items()}
    one, other = (prepared(rig, images, 1, Options(**as_given)) for images in (film.images, still))
    np.testing.assert_array_equal(one.built.measured, other.built.measured)
    np.testing.assert_array_equal(one.registered.active.mask, other.registered.active.mask)


def test_equations_are_of_the_mean_over_what_any_frame_may_light(rig, film, as_given):
    found = prepared(rig, film.images, FRAMES, Options(**as_given))
    for truth in film.truths:
        assert truth[found.registered.active.mask].sum() > 0.999 * truth.sum()
    mean = [film.images[name].mean(axis=0) for name in found.registered.rig.names]
    expected = found.built.system.flatten(mean)
    np.testing.assert_allclose(found.built.measured, expected, atol=1e-5 * expected.max())


def test_an_image_turned_over_is_put_in_place_in_every_frame(rig, film):
    turned = {**film.images, WRONG: film.images[WRONG][:, :, ::-1].copy()}
    options = replace(OPTIONS, refine_cameras=("none",), fit_gain=False)
    found = prepared(rig, turned, FRAMES, options)
    assert "mirrored" in {one.effect for one in found.screened.findings}
    view = found.registered.rig.names.index(WRONG)
    for frame, image in zip(found.frames, film.images[WRONG], strict=True):
        np.testing.assert_array_equal(frame.images[view], image)
