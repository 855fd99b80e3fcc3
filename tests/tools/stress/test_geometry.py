"""The stress of geometry: its rows hold, and would not if tracers were wrong."""

from dataclasses import replace

import numpy as np
import pytest
from _stress import geometry_area, geometry_scenes
from _stress.geometry_large import large_rows
from _stress.geometry_lenses import COUNTS, _there_and_back, random_lens
from _stress.geometry_motion import motion_rows
from _stress.row import Size

from tomo.trace import trace

QUICK = Size(quick=True)


@pytest.mark.parametrize("name", ["Cameras far away", "Rays along faces, edges and axes"])
def test_tracers_hold_at_the_worst(name):
    cases, over = geometry_area.KINDS[name]
    found = list(cases(20, np.random.default_rng(0)))
    rows = list(geometry_area._tracer_rows(name, over, found))
    assert [row.stress for row in rows if not row.holds] == []
    assert len(rows) == 4


def test_a_chord_that_is_off_is_seen():
    case = next(geometry_scenes.voxel_sizes(50, np.random.default_rng(0)))
    sums = geometry_area._Measured(case).stored["march"].row_sums
    assert geometry_scenes.roundings_apart(case, sums) <= 4
    assert geometry_scenes.roundings_apart(case, sums * (1 + 1e-9)) > 4
    moved = replace(case, rays=replace(case.rays, origins=case.rays.origins + 1e-15))
    other = np.diff(trace(moved.rays, case.grid, "reference").ptr)
    assert other.shape == sums.shape


@pytest.mark.parametrize("model", COUNTS)
def test_lenses_are_inverted_or_refused(model):
    random = np.random.default_rng(1)
    error, lost, seen = _there_and_back(random_lens(model, 1, random), random)
    assert error < 1e-6
    assert lost == 0 < seen


def test_rows_of_motion_and_of_large_grids_hold():
    rows = [*motion_rows(QUICK), *large_rows(QUICK)]
    assert [row.stress for row in rows if not row.holds] == []
    assert len(rows) >= 6
