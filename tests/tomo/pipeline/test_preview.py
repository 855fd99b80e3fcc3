"""The preview: a coarser copy of the scan, solved as it stands, ahead of the rest."""

import sys

import numpy as np
import pytest

import phantoms
import rigs
import tomo
from rigs.progress import WHOLE, stage_of
from tomo.pipeline.options import Options
from tomo.pipeline.reconstruct import preview

GRID = tomo.VoxelGrid((20, 40, 20), 0.7)


@pytest.fixture(scope="module", autouse=True)
def few_segments():
    """Have previews of this small scan be coarser than it."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(sys.modules["tomo.pipeline.reconstruct"], "SEGMENTS", 20_000)
        yield


@pytest.fixture(scope="module")
def scan():
    rig = rigs.ring(8, 100.0, image_size=(64, 112), footprint=0.45)
    flame = phantoms.create("jet", extent=GRID.extent)
    return tomo.simulate(rig, flame, GRID, noise=0.001, seed=1)


@pytest.fixture(scope="module")
def run(scan, choose_quickly):
    """Return the whole run, what came early, and the progress with what had come by then."""
    early, calls = [], []
    with choose_quickly():
        outcome = tomo.reconstruct(
            scan,
            early=lambda *one: early.append(one),
            progress=lambda *step: calls.append((*step, len(early))),
        )
    return outcome, early, calls


def test_preview_volume_and_images_come_in_this_order(run):
    outcome, early, _ = run
    assert [step for step, _ in early] == ["preview", "volume", "images"]
    _, volume, images = (found for _, found in early)
    for found in (volume, images):
        np.testing.assert_array_equal(found.volume, outcome.volume)
        assert found.uncertainty is None
        assert found.preview is None
    assert volume.views == ()
    assert images.answer.sentence == outcome.answer.sentence
    assert outcome.half_width is not None


def test_stages_come_in_their_order_around_them(run):
    _, _, calls = run
    first = {}
    for done, total, step, came in calls:
        if step != WHOLE:
            assert 0 <= done <= total
            first.setdefault(stage_of(step)[0], came)
    assert list(first.items()) == [
        ("reading", 0), ("compiling", 0), ("preview", 0),
        ("pixels", 1), ("cameras and gas", 1), ("empty voxels", 1), ("tracing", 1),
        ("basis and weights", 1), ("smoothness", 1), ("solve", 1),
        ("predicted images", 2), ("how far to trust it", 3),
    ]  # fmt: skip


def test_the_whole_is_told_once_the_preview_is_there(run):
    _, _, calls = run
    came = [came for _, _, step, came in calls if step == WHOLE]
    assert min(came) == 1
    shares = [done / total for done, total, step, _ in calls if step == WHOLE]
    assert all(0 <= share <= 1 for share in shares)
    assert shares[-1] > 0.9


def test_it_is_the_volume_but_coarser(run):
    outcome, early, _ = run
    quick = early[0][1]
    assert quick.preview == 2
    grid = quick.solution.grid
    assert grid.shape == tuple(n // 2 for n in GRID.shape)
    np.testing.assert_allclose(grid.extent, GRID.extent)
    whole = np.asarray(outcome.volume, np.float64)
    blocks = whole.reshape(10, 2, 20, 2, 10, 2).mean(axis=(1, 3, 5))
    assert np.linalg.norm(quick.volume - blocks) < 0.15 * np.linalg.norm(blocks)
    assert quick.volume.total() == pytest.approx(outcome.volume.total(), rel=0.05)


def test_its_answer_says_that_it_is_one(run):
    quick = run[1][0][1]
    words = "Preview (pixels and voxels 2 times as wide, nothing corrected): "
    assert quick.answer.sentence.startswith(words)
    assert quick.report()["preview"] == 2
    assert quick.report()["answer"]["sentence"] == quick.answer.sentence
    assert "preview" not in run[0].report()


def test_alone_it_is_the_same(scan, run, quick_choice):
    alone = preview(scan)
    np.testing.assert_array_equal(alone.volume, run[1][0][1].volume)


def test_a_run_with_one_has_the_same_bits_as_one_without(scan, run, quick_choice):
    plain = tomo.reconstruct(scan, uncertainty=0)
    np.testing.assert_array_equal(plain.volume, run[0].volume)


def test_nothing_is_looked_for_and_what_is_known_is_kept(scan, quick_choice):
    found = tomo.preview(scan, hold_out="cam02", method="sirt", uncertainty=9, peak=3.0)
    assert found.options == Options.quick(hold_out=("cam02",), peak=3.0)
    assert found.findings == ()
    assert found.screening is None
    assert found.uncertainty.deviations is None
    assert [view.name for view in found.views if view.held_out] == ["cam02"]
    assert found.report()["method"] == "curvature"


def test_a_scan_that_is_small_is_not_made_smaller(choose_quickly):
    grid = tomo.VoxelGrid((6, 9, 6), 1.0)
    rig = rigs.ring(4, 60.0, image_size=(14, 18), footprint=0.8)
    scan = tomo.simulate(rig, phantoms.create("blobs", extent=grid.extent), grid)
    with choose_quickly():
        quick = tomo.preview(scan)
    assert quick.preview == 1
    assert quick.volume.shape == grid.shape
    assert quick.answer.sentence.startswith("Preview (nothing corrected): ")


def test_a_preview_that_fails_is_a_warning(scan, monkeypatch, quick_choice):
    def fail(*_):
        raise RuntimeError("too coarse")

    monkeypatch.setattr(sys.modules["tomo.pipeline.reconstruct"], "coarser_images", fail)
    steps = []
    found = tomo.reconstruct(scan, uncertainty=0, early=lambda step, outcome: steps.append(step))
    assert steps == ["volume", "images"]
    (line,) = [line for line in found.warnings if line.startswith("preview: ")]
    assert line.startswith("preview: not made: too coarse. The volume is not affected")
