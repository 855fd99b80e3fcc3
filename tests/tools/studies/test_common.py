"""The command that all studies share, with parts made up for the purpose; its files and pages."""

import json
import math
import os
import subprocess
import sys
import types

import pytest
from studies import benchmark, stress
from studies.common import page, timing
from studies.common.study import Study, command
from typer.testing import CliRunner


@pytest.fixture
def study(monkeypatch):
    """Return a function: what each part does, by name, to a function that runs the command."""

    def make(**parts):
        for name, run in parts.items():
            module = types.ModuleType(f"made_up.{name}")
            module.__doc__ = f"What {name} is\nabout."
            module.run = run
            monkeypatch.setitem(sys.modules, f"made_up.{name}", module)
        listed = {name: (name.title(), f"made_up.{name}") for name in parts}
        app = command(Study("study", "A study.", listed, ("full", "quick")))
        return lambda *arguments: CliRunner().invoke(app, [str(a) for a in arguments])

    return make


def rows(*found):
    return lambda request: {"rows": [{"what": "a|b", "found": f, "holds": f < 1} for f in found]}


def parts_in(folder):
    return json.loads((folder / "study.json").read_text("utf-8"))["parts"]


def test_rows_are_written_and_judged(study, tmp_path):
    done = study(first=rows(0.5, 3.0))("-o", tmp_path, "--json")
    assert done.exit_code == 1  # a row does not hold
    found = json.loads(done.stdout)["parts"]["first"]["tables"]["rows"]
    assert [row["holds"] for row in found] == [True, False]
    assert "1 of 2 rows hold" in done.stderr
    text = (tmp_path / "study.md").read_text("utf-8")
    assert "What first is about." in text
    assert "| a\\|b | 3.00 | no |" in text


def test_an_interrupted_run_goes_on(study, tmp_path):
    def fails(request):
        raise RuntimeError("the machine went away")

    done = study(first=rows(0.25), second=fails)("-o", tmp_path)
    assert done.exit_code == 1
    before = parts_in(tmp_path)
    assert list(before) == ["first"]
    assert study(first=fails, second=rows(0.5))("-o", tmp_path, "--resume").exit_code == 0
    assert list(parts_in(tmp_path)) == ["first", "second"]
    assert parts_in(tmp_path)["first"] == before["first"]


def test_parts_run_together_on_one_thread_each(monkeypatch, tmp_path):
    monkeypatch.syspath_prepend(tmp_path)
    for name in ("first", "second"):
        (tmp_path / f"{name}_made_up.py").write_text(
            '"""Which process this is."""\nimport os\n\ndef run(request):\n'
            "    words = os.getpid(), os.environ['NUMBA_NUM_THREADS'], request.seed\n"
            "    return {'rows': [dict(zip(('process', 'threads', 'seed'), words))]}\n"
        )
    listed = {name: (name, f"{name}_made_up") for name in ("first", "second")}
    app = command(Study("study", "A study.", listed, together=("second", "first")))
    done = CliRunner().invoke(app, ["-o", str(tmp_path / "out"), "--seed", "3"])
    assert done.exit_code == 0, done.exception
    parts = parts_in(tmp_path / "out")
    assert list(parts) == ["first", "second"]
    for part in parts.values():
        (row,) = part["tables"]["rows"]
        assert (int(row["threads"]), row["seed"]) == (1, 3)
        assert row["process"] != os.getpid()


def test_only_what_is_asked_runs_with_what_was_asked(study, tmp_path):
    requests = []

    def noted(request):
        requests.append(request)
        return {"rows": [{"found": 1.0}]}

    run = study(first=rows(9.0), second=noted)
    asked = ("--size", "quick", "--seed", 3, "--data", tmp_path)
    assert run("-o", tmp_path, "--part", "second", *asked).exit_code == 0
    (request,) = requests
    assert (request.size, request.seed, request.data) == ("quick", 3, tmp_path)


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("--part", "speed"), "--part: found 'speed', expected one of first"),
        (("--size", "tiny"), "--size: found 'tiny', expected one of full, quick"),
        (("-o", "{}/file"), "file: is a file, expected a folder"),
        (("--data", "{}/none"), "none: no such folder"),
    ],
)
def test_bad_input_is_one_line(study, tmp_path, arguments, words):
    (tmp_path / "file").write_text("x")
    given = [text.format(tmp_path) for text in ("-o", "{}/out", *arguments)]
    done = study(first=rows(0.5))(*given)
    assert done.exit_code == 2
    (line,) = done.stderr.splitlines()
    assert words in line


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"size": "quick"}, "--resume: size: found 'quick', expected 'full'"),
        ({"seed": 3}, "--resume: seed: found 3, expected 0"),
        ({"machine": {"cpu": "Z80", "cores": 1}}, "--resume: cpu: found 'Z80'"),
        ({"machine": 2}, "expected the result of an earlier study run"),
        ({"study": "other"}, "expected the result of an earlier study run"),
        ({"parts": []}, "expected the result of an earlier study run"),
        (None, "expected the result of an earlier study run"),
    ],
)
def test_another_run_is_not_gone_on_with(study, tmp_path, change, words):
    run, file = study(first=rows(0.5)), tmp_path / "study.json"
    assert run("-o", tmp_path).exit_code == 0
    text = file.read_text("utf-8")
    file.write_text("{" if change is None else json.dumps(json.loads(text) | change), "utf-8")
    before = file.read_bytes()
    done = run("-o", tmp_path, "--resume")
    assert done.exit_code == 2
    assert words in done.stderr
    assert file.read_bytes() == before


def test_curves_are_drawn_and_not_stored(study, tmp_path):
    run = study(first=lambda request: {"rows": [{"found": 1.0, "curves": [(1, 2)]}]})
    assert run("-o", tmp_path).exit_code == 0
    assert parts_in(tmp_path)["first"]["tables"] == {"rows": [{"found": 1.0}]}


@pytest.mark.parametrize(
    ("value", "text"),
    [
        (None, "–"),
        (math.nan, "–"),
        (0.0, "0"),
        (1234567, "1,234,567"),
        (1234.5, "1,234"),
        (0.012345, "0.0123"),
        (1.2345e-7, "1.23e-07"),
        (True, "yes"),
        ({"relaxation": 0.3, "subsets": 8}, "relaxation 0.300, subsets 8"),
        ({}, "–"),
    ],
)
def test_cells_are_short(value, text):
    assert page.cell(value) == text


def test_candidates_run_in_turn_and_the_median_counts(monkeypatch):
    order = []
    works = {name: lambda name=name: order.append(name) for name in "ab"}
    seconds = timing.in_turn(works, 3)
    assert order == ["a", "b"] * 4
    assert set(seconds) == {"a", "b"}


def test_a_watch_stands_still_while_it_is_paused():
    watch = timing.Stopwatch()
    with watch.paused() as before:
        subprocess.run([sys.executable, "-c", "import time; time.sleep(0.2)"], check=True)
    with watch.paused() as after:
        pass
    assert after - before < 0.15


def test_a_process_that_fails_says_why():
    with pytest.raises(RuntimeError, match=r"studies\.nothing x: .*No module named"):
        timing.in_fresh_process("studies.nothing", "x")


@pytest.mark.parametrize("study", [benchmark.STUDY, stress.STUDY], ids=lambda study: study.name)
def test_every_part_has_a_module_with_what_the_page_needs(study):
    for part in study.parts:
        assert callable(study.module(part).run)
        assert len(study.about(part)) > 40


@pytest.mark.parametrize("tool", ["benchmark", "stress", "paper"])
def test_every_command_refuses_an_unknown_option_in_one_line(run_tool, tool):
    done = run_tool(tool, "--no-such-thing")
    assert done.exit_code == 2
    (line,) = done.stderr.splitlines()
    assert "--no-such-thing" in line
