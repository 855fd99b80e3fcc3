"""The stress of conditioning: its rows hold, and would not if a method grew or strayed."""

import numpy as np
import pytest
from studies.stress import conditioning, geometry

pytestmark = pytest.mark.usefixtures("quick_choices", "images_as_given")


@pytest.fixture(autouse=True)
def _few(monkeypatch):
    monkeypatch.setattr(conditioning, "VIEWS", (2, 5, 3, 5, 9))


def test_a_fan_spans_its_angle():
    def positions(rig):
        return np.array([camera.position for camera in rig])

    ends = positions(conditioning.fan())[[0, -1]][:, [0, 2]]  # seen from above
    cosine = ends[0] @ ends[1] / np.prod(np.linalg.norm(ends, axis=1))
    assert np.degrees(np.arccos(cosine)) == pytest.approx(conditioning.FAN)


def test_rows_of_rigs_hold():
    found = list(conditioning.rig_rows(quick=True))
    assert len(found) == 5
    assert all(row.holds for row in found)


def test_the_error_turns_and_the_chosen_stop_is_near_its_lowest():
    methods = conditioning._methods(60)
    errors = np.array(methods.chart.curves["cgls"])[:, 1]
    assert errors.argmin() < 20
    assert errors[-1] > 2 * errors.min()
    assert conditioning._chosen([(0.1, 9)]).holds


def test_rows_of_focus_hold():
    found = list(geometry.focus_rows(quick=True))
    assert len(found) == 3
    assert all(row.holds for row in found)
