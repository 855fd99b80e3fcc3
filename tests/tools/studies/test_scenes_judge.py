"""The judge of scenes: what counts as named, rows that later runs extend, and comparisons."""

import dataclasses
import json
import time
from concurrent.futures import ThreadPoolExecutor
from types import SimpleNamespace

import numpy as np
import pytest
from studies.common import processes
from studies.scenes import compare, findings, judge
from studies.scenes.findings import accused, findings_of, is_alarm, named, verdict_of
from studies.scenes.recipe import Recipe

import tomo

CAMERAS = {f"cam{number:02d}": {} for number in range(6)}
PLAIN = Recipe("settle", "tilted cone", "ring-6", "12 bit", 0)
GAIN = dataclasses.replace(PLAIN, fault="gain", size=1)
CAP = dataclasses.replace(PLAIN, fault="cap", size=0)


def test_a_report_with_findings_is_read_there():
    listed = [
        {"effect": "fall-off", "camera": None, "size": 0.2},
        {"effect": "out_of_step", "camera": "cam01"},
        {"effect": "self-absorption"},
        {"effect": "dark", "camera": "cam02"},
        {"effect": "something new", "camera": "cam03"},
    ]
    report = {"findings": listed, "verdict": "red", "views": CAMERAS}
    assert findings_of(report) == findings_of(findings.essence(report)) == [
        ("fall-off", None), ("out of step", "cam01"), ("absorption", None), ("dark", "cam02"),
        ("something new", "cam03"),
    ]  # fmt: skip
    assert findings_of({"findings": []}) == []
    assert verdict_of({"verdict": {"level": "red"}}) == verdict_of({"verdict": "red"}) == "red"


@pytest.mark.parametrize(
    ("expected", "said", "right"),
    [
        ([(("gain",), "cam02")], [("gain", "cam02")], True),
        ([(("gain",), "cam02")], [("gain", None)], False),
        ([(("gain",), "cam02")], [("gain", "cam03")], False),
        ([(("gain",), "cam02")], [("pose", "cam02"), ("gain", "cam02")], True),
        ([(("gain",), "cam02")], [("pose", "cam02"), ("blur", "cam02"), ("gain", "cam02")], False),
        ([(("gain",), "cam02")], [("unexplained", "cam02"), ("gain", "cam02")], True),
        ([(("absorption",), None)], [("absorption", None)], True),
        ([(("background",), None)], [("background", c) for c in CAMERAS], True),
        ([(("gain",), "cam02"), (("pose",), "cam05")], [("gain", "cam02")], False),
        (
            [(("gain",), "cam02"), (("pose",), "cam05")],
            [("pose", "cam05"), ("gain", "cam02")],
            True,
        ),
        ([], [("gain", "cam02")], False),
    ],
)
def test_a_fault_is_named_by_its_effect_and_its_camera(expected, said, right):
    assert named(expected, said) == right


def test_other_cameras_are_accused():
    said = [("gain", "cam02"), ("gain", "cam04"), ("outside", None)]
    assert accused([(("gain",), "cam02")], said) == ["cam04"]
    assert accused([(("background",), None)], said) == []


@pytest.mark.parametrize(
    ("said", "allowed", "alarm"),
    [
        ([], (), False),
        ([("gain", None)], (), True),
        ([("unexplained", None)], (), False),
        ([("unexplained", "cam01")], (), True),
        ([("outside", "cam01")], ("outside",), False),
        ([("outside", "cam01"), ("gain", None)], ("outside",), True),
    ],
)
def test_an_alarm_is_false_where_nothing_is_wrong(said, allowed, alarm):
    assert is_alarm(said, allowed) == alarm


def row(recipe, nrmse, uncorrected, verdict="amber", findings=(), **more):
    expected = [[["gain"], "cam00"]] if recipe.fault == "gain" else [[["dark"], "cam00"]]
    return {
        **dataclasses.asdict(recipe), "scene": recipe.name, "faultless": recipe.faultless.key,
        "nrmse": nrmse, "cosine_distance": 0.01, "cpu_seconds": 2.0, "uncorrected": uncorrected,
        "verdict": verdict, "findings": [list(one) for one in findings],
        "expected": expected if recipe.fault else [], "mendable": recipe.fault != "cap", **more,
    }  # fmt: skip


def rows(*listed):
    return {Recipe(**{f: r[f] for f in FIELDS}).key: r for r in listed}


FIELDS = [field.name for field in dataclasses.fields(Recipe)]
RIGHT = row(PLAIN, 0.05, 0.05, "green")


@pytest.mark.parametrize(
    ("one", "expected"),
    [
        (row(GAIN, 0.05, 0.10, findings=[("gain", "cam00")]), {"named", "harms"}),
        (row(GAIN, 0.08, 0.075), {"harms", "off", "worse"}),
        (row(GAIN, 0.08, 0.08, "green"), {"harms", "off", "green_and_off"}),
        (row(GAIN, 0.052, 0.052, "green"), set()),
        (row(CAP, 0.40, 0.40, "red"), {"harms", "off"}),
        (row(CAP, 0.40, 0.40, "red", [("dark", "cam00")]), {"harms", "named"}),
        (row(CAP, 0.40, 0.40, "green", [("dark", "cam00")]),
         {"harms", "named", "off", "green_and_off"}),
        (row(CAP, 0.08, 0.40, "green", without=0.078), {"harms", "green_and_off"}),
        (row(GAIN, None, 0.08, "error"), {"harms", "off", "worse"}),
    ],
)  # fmt: skip
def test_a_scene_is_scored_beside_the_one_without_its_fault(one, expected):
    both = rows(RIGHT, one)
    score = compare.score(both, list(both)[1])
    found = {key for key in ("named", "off", "green_and_off", "worse") if score[key]}
    tables = compare.tables_of(both)
    assert len(tables["scenes"]) == 1
    assert found | ({"harms"} if tables["faults"] else set()) == expected


def test_trees_are_compared_on_the_scenes_of_both(tmp_path):
    other = dataclasses.replace(PLAIN, seed=1)
    base = rows(RIGHT, row(other, 0.1, 0.1), row(GAIN, 0.05, 0.08))
    own = rows(row(PLAIN, 0.06, 0.05, findings=[("gain", None)]), row(GAIN, 0.09, 0.08))
    tables = compare.tables_of(base, own)
    before, after = tables["faultless"]
    assert (before["scenes"], after["scenes"]) == (1, 1)
    assert after["nrmse"] == pytest.approx(1.2)
    assert (after["above_1.1"], after["above_1.25"], after["alarms"]) == (1, 0, 1)
    shares = {(one["fault"], one["tree"]): one for one in tables["faults"]}
    assert shares["gain", "base"]["off"] == 0
    assert shares["gain", "own"] == shares["all", "own"] | {"fault": "gain"}
    assert (shares["gain", "own"]["off"], shares["gain", "own"]["worse"]) == (1, 1)


def test_a_comparison_is_a_command(run_tool, tmp_path):
    for name in ("a", "b"):
        kept = {"version": 2, "options": {}, "rows": rows(RIGHT, row(GAIN, 0.09, 0.08))}
        (tmp_path / f"{name}.json").write_text(json.dumps(kept))
    files = (str(tmp_path / "a.json"), str(tmp_path / "b.json"))
    done = run_tool("scenes", "--compare", *files, "-o", str(tmp_path))
    assert done.exit_code == 0, done.stderr
    assert "| gain | own | 1 |" in (tmp_path / "compare.md").read_text()


@pytest.fixture
def ran(monkeypatch, in_this_process):
    """Return what was run; scenes come to their seeds, and one fails."""
    done = []

    def judged(recipe, cache, options):
        done.append(recipe)
        if recipe.seed == 3:
            raise KeyboardInterrupt
        return row(recipe, 0.1 * recipe.seed, 0.2) | {"report": {"findings": [{"effect": "gain"}]}}

    monkeypatch.setattr(judge, "judged", judged)
    return done


def test_rows_are_kept_and_extended(ran, tmp_path):
    path, wanted = tmp_path / "rows.json", [dataclasses.replace(PLAIN, seed=n) for n in (1, 2)]
    first = judge.extend(path, wanted[:1], tmp_path, lambda *_: None)
    both = judge.extend(path, wanted, tmp_path, lambda *_: None)
    assert [recipe.seed for recipe in ran] == [1, 2]
    assert both == judge.read_rows(path)
    assert both[wanted[0].key] == first[wanted[0].key]
    assert both[wanted[1].key]["findings"] == [["gain", None]]
    with pytest.raises(ValueError, match=r"rows\.json: found rows of .*expected .*'learn': False"):
        judge.extend(path, wanted, tmp_path, lambda *_: None, options={"learn": False})


def test_rows_are_scored_by_the_faults_of_today(tmp_path):
    old = row(CAP, 0.4, 0.4) | {"expected": [[["other"], "cam03"]], "mendable": True}
    two = row(dataclasses.replace(PLAIN, fault="two at once"), 0.4, 0.4)
    two["expected"] = [[["gain"], "cam00"], [["pose"], "cam03"]]
    path = tmp_path / "rows.json"
    path.write_text(json.dumps({"rows": rows(old, two, RIGHT)}))
    capped, both, right = judge.read_rows(path).values()
    assert capped["expected"] == [[["dark", "hidden"], "cam03"]]
    assert not capped["mendable"]
    assert both["expected"] == two["expected"]
    assert right["expected"] == []


def test_an_interrupted_run_keeps_its_rows(ran, tmp_path):
    path, wanted = tmp_path / "rows.json", [dataclasses.replace(PLAIN, seed=n) for n in (3, 1)]
    judge.extend(path, wanted[1:], tmp_path, lambda *_: None)
    with pytest.raises(KeyboardInterrupt):
        judge.extend(path, wanted, tmp_path, lambda *_: None)
    assert [r["seed"] for r in judge.read_rows(path).values()] == [1]


def test_no_scene_is_begun_after_the_time(monkeypatch):
    monkeypatch.setattr(processes, "_pool", ThreadPoolExecutor)
    jobs = {number: (0.02,) for number in range(20)}
    assert len(list(processes.at_work(time.sleep, jobs, 1, 0.03))) < 6
    assert len(list(processes.at_work(time.sleep, dict(list(jobs.items())[:4]), 2))) == 4


def test_the_uncorrected_solve_checks_nothing_that_the_tree_has(monkeypatch):
    bare = judge.uncorrected(hold_out=("cam00",))
    assert bare.hold_out == ("cam00",)
    known = {field.name for field in dataclasses.fields(tomo.Options)} & set(judge.UNCORRECTED)
    assert {name: getattr(bare, name) for name in known} == {
        name: judge.UNCORRECTED[name] for name in known
    }

    @dataclasses.dataclass(frozen=True)
    class Later:
        learn: bool = True
        hold_out: tuple = ()

    monkeypatch.setattr(judge, "Options", Later)
    assert judge.uncorrected() == Later(learn=False)
    monkeypatch.setattr(judge, "Options", dataclasses.make_dataclass("None_", ["uncertainty"]))
    with pytest.raises(ValueError, match="options: found none of screen"):
        judge.uncorrected()


@pytest.mark.parametrize("fails", [False, True])
def test_a_row_holds_both_solves_and_the_one_without_the_camera(monkeypatch, tmp_path, fails):
    asked = []

    def reconstruct(scan, grid, options):
        asked.append(options)
        if fails and options == tomo.Options():
            raise RuntimeError("no light")
        nrmse = 0.3 - 0.1 * len(asked)
        report = {"quality": {"nrmse": nrmse, "cosine_distance": 0.01}, "verdict": "amber",
                  "findings": [{"effect": "dark", "camera": "cam00"}]}  # fmt: skip
        return SimpleNamespace(report=lambda: report, volume=np.full(3, 1.0 + len(asked)))

    scene = SimpleNamespace(
        scan=None, mendable=False, at_fault=("cam00",), expected=((("dark",), "cam00"),)
    )
    monkeypatch.setattr(judge, "known_scene", lambda recipe, cache: scene)
    monkeypatch.setattr(judge, "warm_up", lambda: None)
    monkeypatch.setattr(judge, "reconstruct", reconstruct)
    found = judge.judged(CAP, tmp_path)
    assert found["uncorrected"] == pytest.approx(0.2)
    if fails:
        assert found["nrmse"] is None
        assert found["error"] == "RuntimeError: no light"
    else:
        assert found["nrmse"] == pytest.approx(0.1)
        assert found["without"] == pytest.approx(0)
        assert found["corrected"]
        assert [one.hold_out for one in asked] == [(), (), ("cam00",)]
