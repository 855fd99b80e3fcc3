"""Images in the wrong place are named first, with the way to mend it."""

from types import SimpleNamespace

import numpy as np
import pytest

import phantoms
import rigs
from tomo import VoxelGrid
from tomo.pipeline.answer import answer_of
from tomo.pipeline.misplaced import find_misplaced
from tomo.pipeline.verdict import AMBER, RED, judge
from tomo.pipeline.view import View
from tomo.simulation import simulate_images

GRID = VoxelGrid((20, 32, 20), 1.0)
RIG = rigs.ring(4, distance=300.0, image_size=(60, 72), footprint=0.5, pitch_degrees=12)


@pytest.fixture(scope="module")
def images():
    field = phantoms.create("turbulent", seed=3, extent=GRID.extent)
    made = simulate_images(RIG, field, GRID, supersample=2, seed=3)
    return [made.images[name] for name in RIG.names]


def outcome(images, held_out=(), known=()):
    """Return a reconstruction whose volume explains nothing."""
    views = tuple(
        View(name, image, np.zeros_like(image), held_out=name in held_out)
        for name, image in zip(RIG.names, images, strict=True)
    )
    screening = {"cameras": {name: {"causes": []} for name in known}}
    nothing = {"alignment": None, "gains": None, "explanation": None}
    grid = SimpleNamespace(grid=GRID)
    return SimpleNamespace(rig=RIG, views=views, solution=grid, screening=screening, **nothing)


def mirrored(images, view):
    return [np.ascontiguousarray(i[:, ::-1]) if n == view else i for n, i in enumerate(images)]


def test_nothing_is_misplaced_where_all_is_right(images):
    assert find_misplaced(outcome(images)) is None


def test_exchanged_cameras_are_named_with_the_way_to_mend_it(images):
    found = find_misplaced(outcome([images[1], images[0], *images[2:]]))
    assert found.reason == "cameras cam00 and cam01 have each other's images"
    assert "exchange their folders" in found.needs


def test_a_mirrored_camera_comes_first_in_the_verdict(images):
    answer = answer_of(outcome(mirrored(images, 2)))
    assert answer.causes[0].startswith("camera cam02's images are mirrored left to right")
    pixels = {"disagrees": True, "pixels": {"cam01": 8.0}}
    report = {"answer": answer.report(), "alignment": {"displacement": pixels}}
    verdict = judge(report)
    assert verdict.level == RED
    assert verdict.reasons[0] == "camera cam02's images are mirrored left to right"
    assert "image[:, ::-1]" in verdict.next[0]
    assert not any("cam01" in reason for reason in verdict.reasons)  # it was pushed aside


def test_a_held_out_camera_that_is_mirrored_checks_nothing(images):
    found = find_misplaced(outcome(mirrored(images, 2), held_out=("cam02",)))
    assert found.held_out
    assert found.cameras == ("cam02",)
    verdict = judge({"answer": {"verdict": "explained", "misplaced": found.report()}})
    assert verdict.level == AMBER
    assert "checks nothing" in verdict.reasons[0]


def test_a_held_out_camera_that_the_screening_names_is_not_named_again(images):
    shown = outcome(mirrored(images, 2), held_out=("cam02",), known=("cam02",))
    assert find_misplaced(shown) is None
