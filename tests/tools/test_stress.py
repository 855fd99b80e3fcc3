"""The stress test's command, with an area made up for the purpose: its files, ends and errors."""

import json
import math
import sys
import types

import pytest


@pytest.fixture
def area(run_tool, monkeypatch):
    """Return a function that sets what the area "values" yields; exceptions are thrown."""

    def set_rows(*rows):
        def yielded(size, progress):
            for row in rows:
                if isinstance(row, Exception):
                    raise row
                yield row

        module = types.ModuleType("_stress.values_area")
        module.rows = yielded
        monkeypatch.setitem(sys.modules, "_stress.values_area", module)

    return set_rows


def rows_of(folder, area="values"):
    return json.loads((folder / "stress.json").read_text("utf-8"))["areas"][area]["rows"]


def test_rows_are_written_and_judged(area, run_tool, tmp_path):
    from _stress.row import Chart, Row

    chart = Chart("error", "px", "error", {"sart": [(0, 0.0), (1, 0.1), (2, 0.3)]})
    area(
        Row("far away", "0 to 1e8", 1e-9, 1e-7, chart=chart),
        Row("too few", "views", 3.0, 4.0, at_least=True, note="left|right"),
    )
    done = run_tool("stress", "--area", "values", "-o", tmp_path, "--json")
    assert done.exit_code == 1, (done.stderr, done.exception)  # a row does not hold
    assert [row["holds"] for row in json.loads(done.stdout)["rows"]] == [True, False]
    page = (tmp_path / "stress.md").read_text("utf-8")
    assert "**1 of 2 rows hold.**" in page
    assert "| too few | views | 3 | ≥ 4 | no |" in page
    assert "left\\|right" in page
    for picture in ("margins", "values_1"):
        assert f"(stress/{picture}.png)" in page
        assert (tmp_path / "stress" / f"{picture}.png").stat().st_size > 1000


def test_all_rows_that_hold_end_well(area, run_tool, tmp_path):
    from _stress.row import Row

    area(Row("repeats", "2 runs", 0, 0, "faults"))
    done = run_tool("stress", "--area", "values", "-o", tmp_path)
    assert done.exit_code == 0, (done.stderr, done.exception)
    assert "What does not hold" not in (tmp_path / "stress.md").read_text("utf-8")


def test_what_an_area_throws_is_a_row_and_earlier_rows_stay(area, run_tool, tmp_path):
    from _stress.row import Row

    area(Row("first", "once", 0.5, 1.0), ZeroDivisionError("by nothing"))
    done = run_tool("stress", "--area", "values", "-o", tmp_path)
    assert done.exit_code == 1
    first, thrown = rows_of(tmp_path)
    assert first["holds"]
    assert not thrown["holds"]
    assert thrown["figure"] == "nan"
    assert thrown["note"].startswith("ZeroDivisionError: by nothing (test_stress.py:")


def test_resumed_run_keeps_what_is_there(area, run_tool, tmp_path):
    from _stress.row import Row

    area(Row("once", "", 0.25, 1.0))
    assert run_tool("stress", "--area", "values", "-o", tmp_path).exit_code == 0
    area(RuntimeError("run again"))
    assert run_tool("stress", "--area", "values", "-o", tmp_path, "--resume").exit_code == 0
    assert rows_of(tmp_path)[0]["figure"] == 0.25
    other = run_tool("stress", "--area", "values", "-o", tmp_path, "--resume", "--quick")
    assert other.exit_code == 2
    assert "--resume: quick: found False, expected True" in other.stderr


@pytest.mark.parametrize("text", ["{", "[]", '{"format": "emission-benchmark", "version": 1}'])
def test_file_of_something_else_is_refused(area, run_tool, tmp_path, text):
    (tmp_path / "stress.json").write_text(text, "utf-8")
    done = run_tool("stress", "--area", "values", "-o", tmp_path, "--resume")
    assert done.exit_code == 2
    assert "expected the result of a stress test" in done.stderr


def test_unknown_area_is_named(run_tool, tmp_path):
    done = run_tool("stress", "--area", "weather", "-o", tmp_path)
    assert done.exit_code == 2
    assert "--area: found 'weather', expected one of geometry, values," in done.stderr


def test_relative_error_neither_overflows_nor_vanishes(run_tool):
    from _stress.row import relative_error

    for scale in (1e-200, 1.0, 1e200):
        assert relative_error([1.1 * scale, 0.0], [scale, 0.0]) == pytest.approx(0.1)
    assert relative_error([math.nan], [1.0]) == math.inf
    assert relative_error([0.0], [0.0]) == 0
    assert relative_error([1.0], [0.0]) == math.inf


def test_not_a_number_is_worst_and_never_holds(run_tool):
    from _stress.row import Row, worst_of

    assert worst_of([("small", 1.0), ("large", 3.0), ("middle", 2.0)]) == (3.0, "large")
    figure, where = worst_of([("large", 3.0), ("none", math.nan), ("more", 5.0)])
    assert math.isnan(figure)
    assert where == "none"
    assert not Row("", "", math.nan, 1.0).holds
    assert not Row("", "", math.nan, 1.0, at_least=True).holds


def test_only_one_line_of_an_error_about_input_is_a_refusal(run_tool):
    from _stress.row import faults_of_refusing

    def throws(error):
        def call():
            raise error

        return call

    calls = {
        "good": throws(ValueError("edge: found 0, expected more")),
        "path": throws(FileNotFoundError("no such file")),
        "two lines": throws(ValueError("one\ntwo")),
        "silent": throws(ValueError("")),
        "wrong kind": throws(KeyError("x")),
        "accepted": lambda: None,
    }
    faults = faults_of_refusing(calls.items())
    assert [fault.partition(":")[0] for fault in faults] == [
        "two lines",
        "silent",
        "wrong kind",
        "accepted",
    ]
