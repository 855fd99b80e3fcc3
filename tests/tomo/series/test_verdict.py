"""The verdict of a film: that of its worst frame, and how many frames have each level."""

from types import SimpleNamespace

import numpy as np
import pytest

from tomo.inference.finding import Finding
from tomo.series.verdict import SeriesTable, verdict_of_series

USED = [f"cam{n}" for n in range(6)]


def verdict(worst, held_out=0.02, complete=True, **plan):
    """Return the verdict of a film of six cameras and one that was held out."""
    count = len(worst)
    beyond = np.full((count, 7), 0.01)
    beyond[:, 2], beyond[:, 6] = worst, held_out
    about = {"plan": plan, "options": {"hold_out": ["apart"]}, "cameras": [*USED, "apart"]}
    store = SimpleNamespace(attributes=about, complete=np.full(count, complete))
    columns = {"view_beyond_noise": beyond}
    return verdict_of_series(SeriesTable(store, np.arange(count), np.arange(count), columns))


def test_a_film_whose_frames_are_all_good_is_green():
    found = verdict([0.01] * 3)
    assert (found["level"], found["frames"]) == ("green", {"green": 3, "amber": 0, "red": 0})
    assert any("apart, which was held out, is predicted" in one for one in found["reasons"])


@pytest.mark.parametrize(
    ("worst", "level", "counts"),
    [
        ([0.01, 0.6, 0.01], "red", {"green": 2, "amber": 0, "red": 1}),
        ([0.01, 0.2, 0.01], "amber", {"green": 2, "amber": 1, "red": 0}),
    ],
)
def test_the_worst_frame_decides_and_frames_are_counted(worst, level, counts):
    found = verdict(worst)
    assert (found["level"], found["frames"]) == (level, counts)
    assert found["reasons"][0].startswith("of 3 frames 2 green")
    assert "in 1 of 3 frames the error to expect" in found["reasons"][1]
    assert found["next"]
    assert found["sentence"].lower().startswith(level)


def test_a_camera_that_is_wrong_in_all_frames_is_named_once():
    hidden = Finding("hidden", "cam3", 0.1, unit="%")
    found = verdict([0.01] * 4, findings=[hidden.report()])
    assert found["level"] == "amber"
    assert len(found["reasons"]) == 1
    assert found["reasons"][0].startswith("camera cam3: 10.0 % of the pixels")


def test_a_held_out_camera_that_is_not_predicted_is_named_and_no_part_of_the_answer():
    found = verdict([0.01] * 4, held_out=0.2)
    assert found["level"] == "amber"
    assert "camera apart is predicted in part" in found["reasons"][0]
    assert len(found["reasons"]) == 1


def test_a_film_without_a_complete_frame_is_red():
    assert verdict([0.01], complete=False)["level"] == "red"
