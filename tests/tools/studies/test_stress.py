"""The rows of the stress test, and its command on the quickest part."""

import json
import math
from dataclasses import replace
from functools import partial

import pytest
from studies.common.scans import reconstructed
from studies.stress import STUDY, growth, order
from studies.stress.row import Chart, Row, charts, measured, relative_error, worst_of
from studies.stress.scene import jet_by, ring

from rigs import Rig


def test_rows_are_plain_and_their_curves_are_drawn():
    chart = Chart("error", "px", "error", {"sart": [(0, 0.0), (1, 0.1), (2, 0.3)]})
    tables = measured(
        [
            Row("far away", "0 to 1e8", 1e-9, 1e-7, chart=chart),
            Row("too few", "views", 3.0, 4.0, "views", at_least=True, note="left"),
            Row.of_faults("faults", "", ["a", "", "b", "a", "c", "d", "e", "f"]),
        ]
    )
    assert [row["holds"] for row in tables["rows"]] == [True, False, False]
    assert (tables["rows"][1]["found"], tables["rows"][1]["bound"]) == ("3.00 views", "≥ 4.00")
    assert tables["rows"][2]["note"] == "a; b; c; d; e"
    assert charts(tables) == ({"error": chart.curves}, "px", "error")
    assert not charts(measured([Row("plain", "", 0, 0)]))[0]


def test_relative_error_neither_overflows_nor_vanishes():
    for scale in (1e-200, 1.0, 1e200):
        assert relative_error([1.1 * scale, 0.0], [scale, 0.0]) == pytest.approx(0.1)
    assert relative_error([math.nan], [1.0]) == math.inf
    assert relative_error([0.0], [0.0]) == 0
    assert relative_error([1.0], [0.0]) == math.inf


def test_not_a_number_is_worst_and_never_holds():
    assert worst_of([("small", 1.0), ("large", 3.0), ("middle", 2.0)]) == (3.0, "large")
    figure, where = worst_of([("large", 3.0), ("none", math.nan), ("more", 5.0)])
    assert math.isnan(figure)
    assert where == "none"
    assert not Row("", "", math.nan, 1.0).holds
    assert not Row("", "", math.nan, 1.0, at_least=True).holds


def test_the_command_runs_the_part_it_is_asked_for(run_tool, tmp_path, monkeypatch):
    monkeypatch.setattr(STUDY.module("scaling"), "run", lambda _: [Row("once", "", 0.25, 1.0)])
    done = run_tool("stress", "--size", "quick", "--part", "scaling", "-o", tmp_path, "--json")
    assert done.exit_code == 0, (done.stderr, done.exception)
    parts = json.loads(done.stdout)["parts"]
    assert parts["scaling"]["tables"]["rows"][0]["stress"] == "once"


@pytest.mark.parametrize(("power", "holds"), [(0.7, True), (1.5, False)])
def test_growth_is_the_power_of_a_line_through_logarithms(power, holds):
    points = [{"views": n, "cpu_seconds": 0.3 * n**power} for n in (6, 12, 24, 48)]
    row = growth.growth_row("cpu_seconds", "views", points, first=True)
    (fit,) = row.lines["fits"]
    assert fit["slope"] == pytest.approx(power)
    assert fit["uncertainty"] == pytest.approx(0, abs=1e-6)
    assert row.holds is holds


def test_an_order_of_cameras_that_changes_the_volume_does_not_hold(monkeypatch, as_given):
    scan = jet_by(ring(5), noise=0.02).scan
    backwards = list(scan.rig.names[::-1])
    monkeypatch.setattr(order, "reconstructed", partial(reconstructed, **as_given))
    assert all(row.holds for row in order.order_rows("as it is", scan, [backwards]))
    without_one = replace(scan, rig=Rig(scan.rig[:-1]))
    monkeypatch.setattr(order, "reordered", lambda *_: without_one)
    assert not next(order.order_rows("a camera is lost", scan, [backwards])).holds
