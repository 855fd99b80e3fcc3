"""The suite of images that hold more physics than the solvers are told."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest


@pytest.fixture(scope="module")
def scene(run_tool):
    """Return a function that makes small scenes."""
    from _benchmark.mismatch_scenes import mismatch_scene
    from _benchmark.sizes import TINY

    def make(effect="gains", noise="clean", seed=1, size=TINY):
        return mismatch_scene(effect, "jet", noise, seed, size)

    return make


@pytest.fixture(scope="module")
def row(run_tool):
    """Return how the methods do on one scene, with a learned method that knows the truth."""
    from _benchmark import mismatch, mismatch_scenes
    from _benchmark.sizes import TINY

    def knows(scan, *, method, fit_gain, seed, blur=0):
        assert (method, fit_gain, seed) == ("wernet", False, 3)
        assert len(scan.rig) == 33
        truth = mismatch_scenes.mismatch_scene("absorption", "jet", "2 %", seed, TINY).truth
        seconds = {"load": 1.0, "compare": 0.0, "condition": 2.0, "total": 7.0}
        return SimpleNamespace(volume=2 * truth, settings={"blur": 0.0}, seconds=seconds)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(mismatch_scenes, "reconstruct", knows)
        return mismatch.mismatch_row("absorption", "jet", "2 %", 3, TINY)


def test_scenes_hold_what_their_name_says(scene):
    from _benchmark.mismatch_scenes import EFFECTS

    plain = scene("pixel area")
    assert not plain.effects.any
    for effect, fields in EFFECTS.items():
        made = scene(effect)
        assert made.effects.any == bool(fields)
        assert all(getattr(made.effects, name) for name in fields)
        differ = [(a != b).any() for a, b in zip(made.images, plain.images, strict=True)]
        assert all(differ) == bool(fields)
        np.testing.assert_array_equal(made.truth, plain.truth)


def test_scenes_repeat(scene):
    from _benchmark import mismatch_scenes

    first = scene(noise="2 %", seed=2)
    mismatch_scenes._clean.cache_clear()
    again, other = scene(noise="2 %", seed=2), scene(noise="2 %", seed=3)
    np.testing.assert_array_equal(first.images, again.images)
    assert (np.asarray(first.images) != other.images).any()
    clean = scene(seed=2)
    noise = np.subtract(first.images, clean.images)
    assert noise.std() == pytest.approx(0.02 * np.max(clean.images), rel=0.05)


def test_optical_depths_are_those_asked_for(scene):
    from _benchmark import mismatch_scenes

    even, own = scene("absorption"), scene("self-absorption")
    assert even.effects.absorption * 15 == pytest.approx(mismatch_scenes.BOX_DEPTH)
    deepest = own.effects.self_absorption * max(np.max(i) for i in scene("pixel area").images)
    assert 0.5 < deepest / mismatch_scenes.FLAME_DEPTH < 1.5


@pytest.mark.parametrize("effect", ["gains + absorption", "self-absorption", "defocus", "all"])
def test_true_weights_explain_the_images(scene, effect):
    from _benchmark.sizes import TINY

    exact = replace(TINY, refine=1, supersample=1)  # nothing is lost on the grid
    made = scene(effect, size=exact)
    ready = made.problem(midpoints=True)
    projector = ready.system.projector
    emission = projector.active.compress(made.truth)
    assert projector.active.size < made.grid.size
    informed = made.informed(ready.system) @ emission
    chords, told = (
        np.linalg.norm(images - ready.measured) / np.linalg.norm(ready.measured)
        for images in (projector @ emission, informed)
    )
    assert told < 0.01
    assert told < 0.3 * chords
    if made.effects.aperture > 0:
        return
    segments = projector.segments
    length = (segments.length * made.weight_ratios(ready.system)).astype(np.float32)
    weighted = type(projector)(
        replace(segments, length=length), made.grid, active=projector.active
    )
    np.testing.assert_allclose(weighted @ emission, informed, rtol=1e-3, atol=1e-4)


@pytest.mark.parametrize(("effect", "noise"), [("heat", "clean"), ("gains", "5 %")])
def test_unknown_scenes(scene, effect, noise):
    with pytest.raises(ValueError, match=r"(effect: found 'heat'|noise: found '5 %'), expected"):
        scene(effect, noise)


def test_a_row_holds_the_best_of_each_kind(row):
    from _benchmark.classic import CLASSIC

    assert len(row.tried) == len(CLASSIC)
    assert {name.split(",")[0] for name in row.tried} == {
        "cgls", "nnls", "sirt", "mlem", "tv", "curvature",
    }  # fmt: skip
    assert row.classic_cosine_distance == min(row.tried.values()) == row.tried[row.classic]
    assert row.classic_pass > 0
    assert row.classic_nrmse > 0.05
    assert 0 < row.informed_cosine_distance < 0.1
    assert row.wernet_cosine_distance == pytest.approx(0, abs=1e-12)
    assert row.wernet_nrmse == pytest.approx(1)  # twice the truth
    assert row.wernet_seconds == 4


def test_means_and_aims_are_of_the_rows(row):
    from _benchmark.claims import claims
    from _benchmark.mismatch import means

    rows = [
        replace(row, seed=seed, effect=effect, classic=classic, classic_cosine_distance=distance,
                wernet_cosine_distance=learned)
        for effect, seed, classic, distance, learned in (
            ("gains", 1, "cgls", 0.02, 0.006), ("gains", 2, "mlem", 0.04, 0.012),
            ("absorption", 1, "mlem", 0.02, 0.006), ("defocus", 1, "mlem", 0.02, 0.0199),
            ("pixel area", 1, "mlem", 0.02, 0.0201),
        )
    ]  # fmt: skip
    found = means(rows)
    assert [mean["seeds"] for mean in found] == [2, 1, 1, 1]
    gains = found[0]
    assert gains["classic"] == "cgls / mlem"
    assert gains["classic_cosine_distance"] == pytest.approx(0.03)
    assert gains["wernet_of_classic"] == pytest.approx(0.3)
    assert gains["informed_of_classic"] > 0
    assert [claim["met"] for claim in claims({"mismatch_mean": found})] == [
        True,
        False,
        True,
        False,
    ]


def test_blobs_are_judged_as_the_volume_that_they_make(scene):
    from _benchmark.courses import course

    made = scene("pixel area")
    ready = made.problem()
    boxes, narrow, wide = (
        course(ready, made.truth, "nnls", {}, passes=4, width=width) for width in (0.0, 1e-3, 1.0)
    )
    assert narrow.cosine_distances == boxes.cosine_distances
    assert wide.cosine_distances[-1] != boxes.cosine_distances[-1]
    assert wide.cosine_distances[-1] < 0.3
