"""Other units of length or intensity change the volume by their factor, and nothing else.

Emission is per unit of length: with all lengths times k and the images as they are, it is 1/k of
what it was.
"""

from dataclasses import replace
from types import MappingProxyType, SimpleNamespace

import numpy as np
import pytest

import phantoms
import rigs
from tomo import LinearSystem, VoxelGrid
from tomo.hull import carve
from tomo.inference.solve import first_fit
from tomo.inference.steps import Null, Steps
from tomo.measurement import estimate_noise
from tomo.model import Absorbing, Background, Gain, Observation, Pose
from tomo.simulation import simulate_images

pytestmark = pytest.mark.usefixtures("quick_choices")

GAIN = 1.2  # of one camera
SHIFT = 2.0  # pixels that another is off
SCALES = {"lengths x 2.9e5": (2.9e5, 1.0), "intensities x 3.7e-6": (1.0, 3.7e-6)}
SCALES["both"] = (1e-6, 1e6)

every_scale = pytest.mark.parametrize("scale", SCALES)


def jet(views, image_size=(24, 40), footprint=0.4, **how):
    grid = VoxelGrid((12, 28, 12), 0.5)
    rig = rigs.ring(
        views,
        distance=300.0,
        image_size=image_size,
        footprint=footprint,
        pitch_degrees=[-10.0 if n % 2 else 10.0 for n in range(views)],
    )
    field = phantoms.create("jet", 1, grid.extent, grid.center)
    return simulate_images(rig, field, grid, supersample=2, refine=2, **how)


def times(array, factor):
    return (factor * array.astype(np.float64)).astype(np.float32)


def in_units(scan, lengths=1.0, intensities=1.0):
    """Return a scan with lengths and intensities times a factor each, and its equations."""
    cameras = tuple(replace(camera, t=camera.t * lengths) for camera in scan.rig)
    images = {name: times(image, intensities) for name, image in scan.images.items()}
    emission = intensities / lengths
    scaled = replace(
        scan,
        rig=replace(scan.rig, cameras=cameras),
        grid=VoxelGrid(scan.grid.shape, np.multiply(scan.grid.spacing, lengths)),
        images=MappingProxyType(images),
        truth=times(scan.truth, emission),
    )
    system = LinearSystem.from_rig(scaled.rig, scaled.grid, form="stored")
    pictures = list(images.values())
    return SimpleNamespace(
        scan=scaled,
        images=pictures,
        emission=emission,
        intensities=intensities,
        system=system,
        projector=system.projector,
        measured=system.flatten(pictures),
    )


@pytest.fixture(scope="module")
def seen():
    return jet(9, noise=0.02)


def apart(found, expected):
    found, expected = np.asarray(found, np.float64), np.asarray(expected, np.float64)
    return np.linalg.norm(found - expected) / np.linalg.norm(expected)


@every_scale
def test_carving_leaves_the_same_voxels(seen, scale):
    plain, other = in_units(seen), in_units(seen, *SCALES[scale])
    expected, found = (
        carve(tuple(one.scan.rig), one.images, None, one.scan.grid) for one in (plain, other)
    )
    np.testing.assert_array_equal(found.active.mask, expected.active.mask)
    assert found.threshold / other.intensities == pytest.approx(expected.threshold, rel=1e-5)
    assert found.smoothing == pytest.approx(expected.smoothing, rel=1e-5)
    assert found.margin == pytest.approx(expected.margin, rel=1e-5)


EFFECTS = (Gain(), Background(), Pose(), Absorbing(own=False), Absorbing(own=True))


@pytest.fixture(scope="module")
def steps_in():
    """Return a function: units to the first steps of effects, in these, and to their nulls.

    Two cameras are wrong.
    """
    finer = jet(6, (48, 80), 0.2, noise=0.01)

    def find(scale):
        one = in_units(finer, *scale)
        first, *rest = one.scan.rig
        rig = replace(one.scan.rig, cameras=(first.shifted(SHIFT, 0.0), *rest))
        images = (*one.images[:3], times(one.images[3], GAIN), *one.images[4:])
        masks = tuple(np.ones(image.shape, bool) for image in images)
        noise = tuple(map(estimate_noise, images, masks))
        seen = Observation(rig, images, masks, noise, one.scan.grid)
        none = {one.name: np.zeros((6, len(one.parameters))) for one in EFFECTS}
        steps = Steps([first_fit(seen)], EFFECTS, none)
        null = Null(steps, None)
        found = {"volume": steps.fits[0].means.astype(np.float64) / one.emission}
        for effect in EFFECTS:
            unit = one.intensities if effect.name == "background" else 1
            if effect.shared:
                of_null = null.of(lambda one, effect=effect: one.shared(effect))
                found[effect.name] = [steps.shared(effect), *of_null]
            else:
                found[effect.name] = steps.own[effect.name] / unit
                found[f"null of {effect.name}"] = null.spread(effect.name) / unit
        return found | {"outside": steps.outside, "hidden": steps.hidden}

    return find, find((1.0, 1.0))


@every_scale
def test_steps_of_effects_are_the_same(steps_in, scale):
    find, expected = steps_in
    assert np.argmax(np.abs(expected["gain"][:, 0])) == 3
    assert np.argmax(np.abs(expected["pose"][:, 0])) == 0
    found = find(SCALES[scale])
    assert found.keys() == expected.keys()
    for name, values in expected.items():
        assert apart(found[name], values) < (1e-4 if name == "volume" else 2e-3), name
