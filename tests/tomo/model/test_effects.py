"""The columns of effects are the changes of the images that their own cameras and gas make."""

from dataclasses import replace
from itertools import pairwise
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.ndimage import zoom

from tomo.grid import VoxelGrid
from tomo.inference.fit import equations_of
from tomo.model import Absorbing, Background, Blur, FallOff, Gain, Pose
from tomo.model.effect import Prediction

EFFECTS = (
    Gain(),
    Background(),
    FallOff(),
    Blur(),
    Absorbing(own=False),
    Absorbing(own=True),
    Pose(),
)
STEPS = {"pose": 1.0, "blur": 0.5, "background": 0.1}  # 0.02 else
LEAST, SLOPES = 0.99, (0.9, 1.15)  # central differences flatten slopes a little
WALKS = (0.95, (0.9, 1.2))  # those of the volume more
CASES = [(effect, k) for effect in EFFECTS for k in range(len(effect.parameters))]


def predicted(observation, volume):
    """Return what a volume shows, traced anew: the equations and the pixels."""
    system = equations_of([observation], None, [volume])[0]
    projector = system.projector
    pixels = projector @ projector.active.compress(volume)
    return system, np.asarray(pixels, np.float64)


@pytest.fixture(scope="module")
def shown(observed):
    """Return exact images of the blobs on fine voxels, and their prediction."""
    observation, truth = observed
    grid = observation.grid
    fine = VoxelGrid(tuple(2 * n for n in grid.shape), grid.spacing[0] / 2)
    volume = np.maximum(zoom(truth, 2, order=3, grid_mode=True, mode="nearest"), 0)
    volume = volume.astype(np.float32)
    seen = replace(observation, grid=fine)
    system, pixels = predicted(seen, volume)
    seen = replace(seen, images=tuple(system.images(pixels.astype(np.float32))))
    unknowns = system.projector.active.compress(volume)
    return SimpleNamespace(
        observation=seen, volume=volume, at=Prediction(seen, system, unknowns), base=pixels
    )


def change(effect, shown, parameter, size):
    """Return the change of the images by a unit of a parameter of all views.

    Where an effect corrects images, the images that it makes are those whose correction it is.
    """
    sides = []
    for sign in (1, -1) if effect.positive is False else (1, 0):
        values = np.zeros((6, len(effect.parameters)))
        values[:, parameter] = sign * size
        seen = effect.applied(shown.observation, values)
        if effect.of_cameras or effect.of_gas or effect.name == "blur":
            sides.append(predicted(seen, shown.volume)[1])
        else:
            sides.append(-shown.at.system.flatten(list(seen.images)).astype(np.float64))
    return (sides[0] - sides[1]) / (size if effect.positive else 2 * size)


@pytest.mark.parametrize(
    ("effect", "parameter"), CASES, ids=[f"{e.name}-{e.parameters[k]}" for e, k in CASES]
)
def test_columns_are_finite_differences(shown, effect, parameter):
    column = effect.columns(shown.at)[parameter]
    assert effect.columns(shown.at).shape == (len(effect.parameters), len(shown.base))
    by = change(effect, shown, parameter, STEPS.get(effect.name, 0.02))
    ptr = shown.at.system.projector.view_ptr
    walks = effect.parameters[parameter] in ("aside", "above")
    least, (low, high) = WALKS if walks else (LEAST, SLOPES)
    for start, stop in pairwise(ptr):
        one, other = column[start:stop], by[start:stop]
        both = float(one @ other)
        assert both / np.sqrt((one @ one) * (other @ other)) > least
        assert low < both / (one @ one) < high


def test_effects_do_to_images_what_their_names_say(shown):
    """Signs by physics: more gain is more light, gas and lenses take light, blur lowers peaks."""
    base, at = shown.base, shown.at
    lit = base > 0.2 * base.max()
    assert (Gain().columns(at)[0][lit] > 0).all()
    assert (FallOff().columns(at)[0][lit] < 0).all()
    for own in (True, False):
        assert (Absorbing(own=own).columns(at)[0][lit] < 0).all()
    assert Blur().columns(at)[0][np.argmax(base)] < 0
    column = Pose().columns(at)
    width = shown.observation.images[0].shape[1]
    x, y = at.system.pixels[0] % width, at.system.pixels[0] // width
    first = slice(0, len(x))
    light = base[first].sum()
    assert column[0][first] @ x / light == pytest.approx(1, abs=0.01)  # a pixel to the right
    assert column[1][first] @ y / light == pytest.approx(1, abs=0.01)
