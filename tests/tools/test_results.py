"""What the studies' results share."""

import json
import math

import numpy as np
import pytest

RUN = {"format": "x", "version": 2, "size": "full", "machine": {"cores": 2}, "parts": {}}
WANTED = {"size": "full", "machine": {"cores": 2}}


@pytest.fixture(scope="module")
def results(run_tool):  # which puts tools/ on the path
    import _results

    return _results


def test_plain_data_are_what_json_holds(results):
    data = {
        "numbers": (np.float64(1 / 3), np.float32(0.5), np.int64(123456), 1e-30),
        "none": [math.nan, -math.inf, np.float32("nan"), None],
        7: {"words": "a", "met": np.True_},
    }
    found = results.plain(data, digits=3)
    assert found == {
        "numbers": [0.333, 0.5, 123456, 1e-30],
        "none": [None] * 4,
        "7": {"words": "a", "met": True},
    }
    assert json.loads(json.dumps(found, allow_nan=False)) == found
    assert results.plain(data)["numbers"][0] == 1 / 3


def test_an_earlier_run_is_gone_on_with(results, tmp_path):
    file = tmp_path / "run.json"
    assert results.earlier_run(file, ("x", 2), WANTED) == {}
    results.write_json(file, RUN)
    assert results.earlier_run(file, ("x", 2), WANTED) == RUN


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"machine": {"cores": 4}}, "--resume: cores: found 4, expected 2"),
        ({"size": "quick"}, "--resume: size: found 'quick', expected 'full'"),
        ({"version": 1}, "expected the result of an earlier run, x 2"),
        ({"machine": 2}, "expected the result of an earlier run, x 2"),
        ({"parts": []}, "expected the result of an earlier run, x 2"),
    ],
)
def test_another_run_is_refused_in_one_line(results, tmp_path, change, words):
    file = tmp_path / "run.json"
    results.write_json(file, RUN | change)
    with pytest.raises(ValueError, match=r"run\.json: ") as error:
        results.earlier_run(file, ("x", 2), WANTED)
    assert words in str(error.value)
    assert "\n" not in str(error.value)
