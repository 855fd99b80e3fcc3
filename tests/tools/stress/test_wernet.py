"""WERNet's rows at the smallest size, and that they can fail."""

from dataclasses import replace

import numpy as np
import pytest
from _stress import wernet_area, wernet_paper, wernet_scene
from _stress.row import Size

QUICK = Size(quick=True)


@pytest.fixture(scope="module")
def seen():
    return wernet_scene.scene()


@pytest.fixture(scope="module")
def classic(seen):
    return seen.classic()


def test_encoders_that_explode_leave_the_classic_solve(seen, classic):
    (row,) = wernet_area._exploding(seen, classic, QUICK)
    assert row.holds, row.note


def test_images_that_say_nothing_leave_the_classic_solve(seen, classic):
    rows = list(wernet_area._little(seen, classic, QUICK))
    assert len(rows) == 2
    assert all(row.holds for row in rows), [row.note for row in rows]


def test_rays_that_cross_no_voxel_do_no_harm(seen, classic):
    (row,) = wernet_area._empty(seen, classic, QUICK)
    assert row.holds, row.note
    assert not row.over.startswith("0%")


def test_pixels_that_are_no_numbers_are_refused(seen, classic):
    (row,) = wernet_area._refused(seen, classic, QUICK)
    assert row.holds, row.note


def test_a_worse_volume_and_a_silent_end_do_not_hold(seen, classic):
    good = wernet_scene.run("good", wernet_area._solve(seen, iterations=0))
    assert wernet_area.over_classic([good], seen, classic)[0] == pytest.approx(1.0)
    noise = np.random.default_rng(0).random(classic.shape).astype(np.float32)
    worse = replace(good, found=replace(good.found, volume=noise))
    assert wernet_area.over_classic([good, worse], seen, classic)[0] > 1.1

    def fails():
        raise TypeError("a defect")

    assert "TypeError" in wernet_scene.run("bad", fails).fault
    silent = wernet_scene.run("silent", lambda: replace(good.found, stop_reason=""))
    assert not wernet_paper._row("", "", [good, silent]).holds
    assert not wernet_area._row_of_fallback("", "", [worse], classic).holds


def test_the_rate_of_learning_is_what_is_asked_for(seen, classic):
    volumes = []
    for rate in (3e-3, 0.3):
        with wernet_scene.trained_with(rate=rate) as counts:
            solve = wernet_area._solve(seen, start=classic, iterations=1)
            history = wernet_scene.run("", solve).found.history
            volumes.append(history[1].relative_residual)
        assert counts["gradients"] > 0
    assert volumes[0] != volumes[1]
