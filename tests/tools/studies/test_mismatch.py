"""The suite of images that hold more physics than the solvers know."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from studies.benchmark import mismatch
from studies.benchmark.convergence import CLASSIC
from studies.benchmark.mismatch import EFFECTS, mismatch_row, mismatch_scene
from studies.benchmark.sizes import SIZES

TINY = SIZES["tiny"].shown


@pytest.fixture(scope="module")
def scene():
    """Return a function that makes small scenes."""

    def make(effect="gains", noise="clean", seed=1, size=TINY):
        return mismatch_scene(effect, "jet", noise, seed, size)

    return make


@pytest.fixture(scope="module")
def row():
    """Return how the methods do on one scene, with a learned method that knows the truth."""

    def knows(scan, *, method, seed):
        assert (method, seed) == ("wernet", 3)
        assert len(scan.rig) == 33
        seconds = {"load": 1.0, "compare": 0.0, "evaluate": 0.0, "uncertainty": 2.0, "total": 7.0}
        return SimpleNamespace(volume=2 * scan.truth, seconds=seconds)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(mismatch, "reconstructed", knows)
        return mismatch_row("absorption", "jet", "2 %", 3, TINY, 6)


def test_scenes_hold_what_their_name_says(scene):
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
    first = scene(noise="2 %", seed=2)
    mismatch._clean.cache_clear()
    again, other = scene(noise="2 %", seed=2), scene(noise="2 %", seed=3)
    np.testing.assert_array_equal(first.images, again.images)
    assert (np.asarray(first.images) != other.images).any()
    clean = scene(seed=2)
    noise = np.subtract(first.images, clean.images)
    assert noise.std() == pytest.approx(0.02 * np.max(clean.images), rel=0.05)


@pytest.mark.parametrize("effect", ["gains + absorption", "self-absorption", "defocus", "all"])
def test_true_weights_explain_the_images(scene, effect):
    exact = replace(TINY, refine=1, supersample=1)  # nothing is lost on the grid
    made = scene(effect, size=exact)
    ready = made.problem(midpoints=True)
    projector = ready.system.projector
    emission = projector.active.compress(made.truth)
    assert projector.active.size < made.grid.size
    informed = made.informed(ready.system) @ emission
    by_lengths, by_weights = (
        np.linalg.norm(images - ready.measured) / np.linalg.norm(ready.measured)
        for images in (projector @ emission, informed)
    )
    assert by_weights < 0.01
    assert by_weights < 0.3 * by_lengths
    if made.effects.aperture > 0:
        return
    segments = projector.segments
    length = (segments.length * made.weight_ratios(ready.system)).astype(np.float32)
    weighted = type(projector)(
        replace(segments, length=length), made.grid, active=projector.active
    )
    np.testing.assert_allclose(weighted @ emission, informed, rtol=1e-3, atol=1e-4)


def test_a_row_holds_the_best_of_each_kind(row):
    tried = dict(row["tried"])
    assert len(tried) == len(CLASSIC)
    assert {name.split(",")[0] for name in tried} == {
        "cgls", "nnls", "sirt", "mlem", "tv", "curvature",
    }  # fmt: skip
    assert row["classic_cosine_distance"] == min(tried.values())
    assert row["classic_cosine_distance"] == tried[row["classic"]]
    assert row["classic_pass"] > 0
    assert row["classic_nrmse"] > 0.05
    assert 0 < row["informed_cosine_distance"] < 0.1
    assert row["wernet_cosine_distance"] == pytest.approx(0, abs=1e-12)
    assert row["wernet_nrmse"] == pytest.approx(1)  # twice the truth
    assert row["wernet_seconds"] == 4
    assert row["informed_of_classic"] == pytest.approx(
        row["informed_cosine_distance"] / row["classic_cosine_distance"]
    )
