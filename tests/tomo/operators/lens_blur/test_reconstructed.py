"""What a kernel and a reconstruction make of images out of focus, the blur given or not."""

import json
import re

import numpy as np
import pytest

from tomo import load_scan
from tomo.pipeline import Options, reconstruct

pytestmark = pytest.mark.usefixtures("quick_choices")


@pytest.fixture(scope="module")
def scans(tmp_path_factory, out_of_focus, in_focus):
    """Return the scan out of focus and that in focus."""
    folder, found = tmp_path_factory.mktemp("focus"), []
    for name, one in (("out", out_of_focus), ("in", in_focus)):
        one.scan.save(folder / name)
        found.append(load_scan(folder / name))
    return found


def distance(outcome):
    return outcome.solution.quality["cosine_distance"]


def residual(outcome):
    return outcome.solution.relative_residual


def test_the_images_of_a_lens_are_near(out_of_focus):
    """Rays through all of a lens, through finer voxels, agree with the lines once kernel.

    What is left is what voxels of half the disc's width miss of edges.
    """
    one = out_of_focus
    measured = one.system.flatten(one.images)
    truth = one.truth.ravel()
    apart = [
        np.linalg.norm(system.projector @ truth - measured) / np.linalg.norm(measured)
        for system in (one.system, one.system.with_lens_blur(one.blur))
    ]
    assert apart[1] < 0.2 * apart[0]


def test_wernet_sees_through_a_disc(scans, out_of_focus, as_given):
    settings = as_given | {"method": "wernet", "iterations": 3, "hold_out": ["cam02"]}
    # the basis of what is reconstructed through a disc
    settings |= {"compare": ["mlem:30"], "basis": "voxel"}
    found, unaware = (
        reconstruct(scans[0], options=Options(**settings, blur=blur))
        for blur in (out_of_focus.blur, 0)
    )
    report = json.loads(json.dumps(found.report(), allow_nan=False))
    assert report["settings"]["blur"] == out_of_focus.blur
    assert distance(found) < 0.7 * distance(unaware)
    views = [{view.name: view for view in one.views}["cam02"] for one in (found, unaware)]
    assert views[0].held_out
    psnr = [view.similarity(found.peak.value)["psnr"] for view in views]
    assert psnr[0] > psnr[1] + 3
    mlem = [one.comparisons[0].quality["cosine_distance"] for one in (found, unaware)]
    assert mlem[0] < 0.8 * mlem[1]
    assert unaware.options.blur == 0


@pytest.mark.parametrize(("method", "projector"), [("auto", "stored"), ("sirt", "on-the-fly")])
def test_others_see_through_a_disc_that_is_given(scans, out_of_focus, as_given, method, projector):
    settings = as_given | {"method": method, "projector": projector}
    aware = reconstruct(scans[0], options=Options(**settings, blur=out_of_focus.blur))
    unaware = reconstruct(scans[0], options=Options(**settings))
    assert distance(aware) < 0.75 * distance(unaware)
    # the basis of the one that knows the disc
    boxes = reconstruct(scans[0], options=Options(**settings, basis="voxel"))
    assert residual(aware) < residual(boxes)
    assert unaware.options.blur == 0


@pytest.mark.parametrize(
    ("settings", "words"),
    [
        ({"blur": -1.0}, "blur: found -1.0, expected a number >= 0"),
        ({"blur": float("nan")}, "blur: found nan"),
        ({"blur": "much"}, "blur: found 'much'"),
        (
            {"blur": 1.0, "method": "art"},
            "blur: found 1.0, expected 0 for method art: it goes ray by ray",
        ),
        (
            {"blur": 1.0, "method": "sirt", "compare": ["wernet-paper:1"]},
            "blur: found 1.0, expected 0 for method wernet-paper",
        ),
    ],
)
def test_what_makes_no_sense_is_refused(scans, settings, words):
    with pytest.raises(ValueError, match=f"^{re.escape(words)}"):
        reconstruct(scans[0], options=Options(**settings))
