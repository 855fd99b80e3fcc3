"""The stress of values: its rows hold, and would not if solvers or masks were wrong."""

import numpy as np
import pytest
from _stress import values_area
from _stress.values_pixels import CORE, pixel_rows
from _stress.values_scene import SHAPE, run, scene


@pytest.fixture(scope="module")
def seen():
    return scene(noise=0.02)


@pytest.fixture(scope="module")
def quick(seen):
    return [case for case in seen.cases() if case[0] in ("cgls, stored", "mlem, stored")]


def test_both_forms_of_the_matrix_see_the_same(seen):
    volume = seen.truth.ravel().astype(np.float64)
    assert seen.truth.shape == SHAPE
    np.testing.assert_allclose(seen.on_the_fly @ volume, seen.stored @ volume, atol=1e-4)


def test_rows_of_intensities_hold(seen, quick):
    found = [
        *values_area._scaled(seen, quick, (1e-30, 1e30)),
        *values_area._uneven(seen, quick),
        *values_area._degenerate(seen, quick),
        *values_area._single(seen, quick),
    ]
    assert len(found) == 8
    assert all(row.holds for row in found)


@pytest.mark.parametrize("wrong", [np.nan, np.inf, -1.0])
def test_a_method_that_is_wrong_shows(seen, quick, monkeypatch, wrong):
    def broken(method, projector, measured, *arguments, **settings):
        found = run(method, projector, measured, *arguments, **settings)
        if np.abs(measured).max() > 1e20:
            found.volume[0, 0, 0] = wrong * found.volume.max()
        return found

    monkeypatch.setattr(values_area, "run", broken)
    intensities = next(values_area._scaled(seen, quick, (1e30,)))
    no_flame = next(values_area._degenerate(seen, quick))
    assert not intensities.holds
    assert not no_flame.holds


def test_rows_of_wrong_pixels_hold_or_say_why_not(seen):
    found = list(pixel_rows(seen))
    assert len(found) == 10
    assert [row.note for row in found if not row.holds] == [CORE]
