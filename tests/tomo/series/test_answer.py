import numpy as np
import pytest

from tomo.series.verdict import answer_of_series

CAMERAS = ("left", "right", "held")


def answer(worst, complete=None):
    beyond = np.full((len(worst), 3), np.nan)
    beyond[:, 0], beyond[:, 1] = 0, worst
    beyond[~np.isfinite(beyond[:, 1]), 0] = np.nan
    complete = np.ones(len(worst)) if complete is None else complete
    table = {"view_beyond_noise": beyond, "complete": complete}
    return answer_of_series(table, range(100, 100 + len(worst)), CAMERAS)


@pytest.mark.parametrize(
    ("worst", "verdict", "words"),
    [
        ([0] * 8, "explained", "all 8 frames are explained"),
        ([0] * 5 + [0.3], "explained", "5 of 6 frames are explained"),
        ([0.02] * 3, "partly explained", "all 3 frames but for up to 10%"),
        ([0.2] * 3 + [0.01], "not explained", "3 of 4 frames miss more than 10% of an image"),
        ([0, np.nan], "explained", "1 of 2 frames are dark"),
        ([np.nan] * 3, "not known", "Not known"),
    ],
)
def test_the_answer_counts_frames_and_takes_the_middle_one(worst, verdict, words):
    found = answer(worst)
    assert found.verdict == verdict
    assert words in found.sentence
    assert found.explained + found.partly + found.not_explained + found.unknown == len(worst)


def test_the_least_explained_frame_and_camera_are_named():
    found = answer([0.02, 0.35, 0.02])
    assert "least well frame 101, where camera right is off by 35%" in found.sentence


def test_frames_that_are_not_complete_do_not_count():
    found = answer([0.01, 0.9, 0.01], np.array([1, 2, 0]))
    assert "all 1 frames" in found.sentence
    assert found.not_explained == 0
