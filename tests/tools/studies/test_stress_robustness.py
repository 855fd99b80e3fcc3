"""The stress of robustness: its rows hold, and do not where nothing is left out."""

from functools import partial

import numpy as np
import pytest
from studies.stress import robustness as area
from studies.stress import robustness_scene as scenes
from studies.stress.robustness_scene import (
    WRONG,
    one_bad_pixel,
    scene,
    with_bad_pixels,
    wrong_views,
)

pytestmark = pytest.mark.usefixtures("quick_choices")

SHRINK = 0.35


@pytest.fixture(scope="module")
def flame():
    """Return a flame before a third of the study's cameras."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(scenes, "PRESET", "paper11_33deg")
        patch.setattr(scenes, "OTHER", 3)
        yield scene("turbulent", 1, SHRINK)


def test_a_wrong_view_is_named_and_one_that_is_kept_is_a_fault(flame, monkeypatch):
    images = dict((name, i) for name, i, _ in wrong_views(flame, 1, SHRINK))["upside down"]
    reconstruct = partial(scenes.reconstructed, basis="voxel")  # which a wrong view costs more
    monkeypatch.setattr(scenes, "reconstructed", reconstruct)
    found = area._Measured(flame)
    name = flame.rig.names[WRONG]
    found.add("view", "upside down", images, (name,))
    assert found.errors["view"][0][1] < area.WORSE
    assert not found.faults["view"]

    monkeypatch.setattr(
        scenes,
        "reconstructed",
        lambda scan, **k: reconstruct(
            scan, screen=False, refine_cameras="none", fit_absorption=False, **k
        ),
    )
    kept = area._Measured(flame)
    kept.add("view", "upside down", images, (name,))
    assert kept.errors["view"][0][1] > 1.1 * found.errors["view"][0][1]
    assert kept.faults["view"] == [f"turbulent, upside down: {name} not named"]


def test_bad_pixels_are_bad():
    images = [np.ones((40, 50), np.float32)] * (WRONG + 1)
    shares = [np.mean(image != 1) for image in with_bad_pixels(images, 0.01, 0)]
    assert np.mean(shares) == pytest.approx(0.01 * 2 / 3, rel=0.3)  # the maximum is no change
    changed = one_bad_pixel(images)
    assert sum(np.count_nonzero(image != 1) for image in changed) == 1


def test_every_wrong_view_is_another_image(flame):
    seen = [images[WRONG] for _, images, _ in wrong_views(flame, 1, SHRINK)]
    assert len(seen) == 9
    for image in seen:
        assert image.shape == flame.images[WRONG].shape
        assert not np.array_equal(image, flame.images[WRONG])
