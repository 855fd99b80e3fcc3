"""The stress of conditioning: its rows hold, and would not if a method grew or strayed."""

from dataclasses import replace

import numpy as np
import pytest
from _stress import (
    conditioning_grazing,
    conditioning_long,
    conditioning_rigs,
    conditioning_stops,
    conditioning_twins,
)

RUN = conditioning_long.run


@pytest.fixture(autouse=True)
def _few(monkeypatch):
    monkeypatch.setattr(conditioning_long, "QUICK", 100)
    monkeypatch.setattr(conditioning_rigs, "VIEWS", (2, 5, 3, 5, 9))


def test_a_fan_spans_its_angle():
    def positions(rig):
        return np.array([camera.position for camera in rig])

    ends = positions(conditioning_rigs.fan())[[0, -1]][:, [0, 2]]  # seen from above
    cosine = ends[0] @ ends[1] / np.prod(np.linalg.norm(ends, axis=1))
    assert np.degrees(np.arccos(cosine)) == pytest.approx(conditioning_rigs.FAN)


def test_rows_of_long_runs_hold():
    found = list(conditioning_long.long_rows(quick=True))
    assert len(found) == 5
    assert all(row.holds for row in found)


def test_rows_of_rigs_hold():
    found = list(conditioning_rigs.rig_rows(quick=True))
    assert len(found) == 6
    assert all(row.holds for row in found)


def test_rows_of_double_precision_hold_and_show_what_is_off_by_a_thousandth(monkeypatch):
    assert all(row.holds for row in conditioning_twins.twin_rows())

    def off(*arguments, **settings):
        found = RUN(*arguments, **settings)
        return replace(found, volume=found.volume * 1.001)

    monkeypatch.setattr(conditioning_twins, "run", off)
    assert not next(conditioning_twins.twin_rows()).holds


def test_growth_that_no_stop_ends_shows(monkeypatch):
    def growing(method, projector, measured, count, **settings):
        found = RUN(method, projector, measured, count, **settings)
        if method != "sirt":
            return found
        last = replace(found.history[-1], relative_residual=10.0)
        return replace(found, history=(*found.history[:-1], last))

    monkeypatch.setattr(conditioning_long, "run", growing)
    names = [row.stress for row in conditioning_long.long_rows(quick=True) if not row.holds]
    assert any("residual at the end" in name for name in names)


def test_rays_that_graze_throw_no_voxel_off_and_one_that_is_shows(monkeypatch):
    (found,) = conditioning_grazing.grazing_rows(quick=True)
    assert found.holds

    def thrown(*arguments, **settings):
        done = RUN(*arguments, **settings)
        return replace(done, volume=np.where(done.volume == done.volume.max(), 1e9, done.volume))

    monkeypatch.setattr(conditioning_grazing, "run", thrown)
    (found,) = conditioning_grazing.grazing_rows(quick=True)
    assert not found.holds


def test_the_error_turns_and_the_chosen_stop_is_near_its_lowest():
    methods = conditioning_stops._methods(60)
    errors = np.array(methods.chart.curves["cgls"])[:, 1]
    assert errors.argmin() < 20
    assert errors[-1] > 2 * errors.min()
    assert conditioning_stops._chosen([(0.1, 9)]).holds
