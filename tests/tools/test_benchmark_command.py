"""The benchmark's command without its studies: what it keeps, what it refuses; and its pieces."""

import json
import subprocess
import sys
from pathlib import Path

import pytest

TOOLS = Path(__file__).resolve().parents[2] / "tools"


@pytest.fixture
def stubs(run_tool, monkeypatch):
    """Put studies of no work in place of the real ones; return the list of those that ran."""
    from _benchmark import PARTS, parts, warm

    ran = []

    def stub(name):
        def run(asked):
            ran.append(name)
            return {"threads": []}, [f"run {len(ran)}"]

        return run

    monkeypatch.setattr(warm, "warm_up", lambda: 0.0)
    monkeypatch.setattr(parts, "PARTS", {name: stub(name) for name in PARTS})
    return ran


def test_an_interrupted_run_goes_on(run_tool, stubs, monkeypatch, tmp_path):
    from _benchmark import PARTS, parts

    def fail(asked):
        raise RuntimeError("the machine went away")

    working = dict(parts.PARTS)
    monkeypatch.setitem(parts.PARTS, "scaling", fail)
    done = run_tool("benchmark", "--quick", "-o", tmp_path)
    assert done.exit_code == 1
    before = json.loads((tmp_path / "benchmark.json").read_text("utf-8"))["parts"]
    assert list(before) == ["projectors", "solvers", "skipping", "basis"]

    monkeypatch.setattr(parts, "PARTS", working)
    stubs.clear()
    assert run_tool("benchmark", "--quick", "--resume", "-o", tmp_path).exit_code == 0
    assert stubs == ["scaling", "startup", "mismatch", "training"]
    after = json.loads((tmp_path / "benchmark.json").read_text("utf-8"))["parts"]
    assert tuple(after) == PARTS
    assert all(after[name] == before[name] for name in before)


def test_a_part_goes_on_between_its_rows(run_tool, stubs, monkeypatch, tmp_path):
    from _benchmark import parts

    def two_rows_at_most(asked):
        rows = [*asked.kept]
        while len(rows) < 3:
            if len(rows) == len(asked.kept) + 2:
                raise RuntimeError("the machine went away")
            rows.append({"row": len(rows)})
            asked.keep(rows)
        return {"mismatch": rows}, []

    monkeypatch.setitem(parts.PARTS, "mismatch", two_rows_at_most)
    arguments = ("benchmark", "--quick", "--part", "mismatch", "-o", tmp_path)
    assert run_tool(*arguments).exit_code == 1
    kept = json.loads((tmp_path / "benchmark.json").read_text("utf-8"))
    assert kept["begun"] == {"mismatch": [{"row": 0}, {"row": 1}]}
    assert kept["parts"] == {}
    assert run_tool(*arguments, "--resume").exit_code == 0
    ended = json.loads((tmp_path / "benchmark.json").read_text("utf-8"))
    assert ended["begun"] == {}
    assert ended["parts"]["mismatch"]["studies"]["mismatch"] == [{"row": n} for n in range(3)]
    # asked for again, a part begins anew, and goes on from there; what was stands until it ends
    assert run_tool(*arguments, "--resume", "--redo", "mismatch").exit_code == 1
    kept = json.loads((tmp_path / "benchmark.json").read_text("utf-8"))
    assert kept["begun"] == {"mismatch": [{"row": 0}, {"row": 1}]}
    assert kept["parts"] == ended["parts"]
    assert run_tool(*arguments, "--resume").exit_code == 0
    again = json.loads((tmp_path / "benchmark.json").read_text("utf-8"))
    assert again["begun"] == {}
    assert again["parts"]["mismatch"]["studies"] == ended["parts"]["mismatch"]["studies"]
    assert again["parts"] != ended["parts"]  # its seconds


def test_only_what_is_asked_runs(run_tool, stubs, tmp_path):
    arguments = ("benchmark", "--quick", "-o", tmp_path)
    assert run_tool(*arguments, "--part", "startup", "--part", "scaling").exit_code == 0
    assert stubs == ["startup", "scaling"]
    assert run_tool(*arguments, "--resume", "--redo", "scaling").exit_code == 0
    others = ["projectors", "solvers", "skipping", "basis", "scaling", "mismatch", "training"]
    assert stubs[2:] == others
    assert run_tool(*arguments, "--part", "startup").exit_code == 0
    parts = json.loads((tmp_path / "benchmark.json").read_text("utf-8"))["parts"]
    assert list(parts) == ["startup"]  # without --resume a run begins anew


def test_a_failing_study_is_no_bad_input(run_tool, stubs, monkeypatch, tmp_path):
    from _benchmark import parts

    def fail(asked):
        raise ValueError("shapes differ")

    monkeypatch.setitem(parts.PARTS, "solvers", fail)
    done = run_tool("benchmark", "-o", tmp_path)
    assert done.exit_code == 1
    assert isinstance(done.exception, ValueError)


def change(result, key, value):
    result[key] = value


OTHERS = {
    "size": (
        lambda r: change(r, "size", "full"),
        "--resume: size: found 'full', expected 'quick'",
    ),
    "machine": (lambda r: change(r["machine"], "cpu", "Z80"), "--resume: cpu: found 'Z80'"),
    "format": (lambda r: change(r, "format", "x"), "expected the result of a benchmark"),
    "lacking": (lambda r: r.pop("machine"), "expected the result of a benchmark"),
}


@pytest.mark.parametrize("fault", OTHERS)
def test_another_run_is_not_gone_on_with(run_tool, stubs, tmp_path, fault):
    spoil, words = OTHERS[fault]
    assert run_tool("benchmark", "--quick", "-o", tmp_path).exit_code == 0
    file = tmp_path / "benchmark.json"
    result = json.loads(file.read_text("utf-8"))
    spoil(result)
    file.write_text(json.dumps(result), "utf-8")
    before = file.read_bytes()
    done = run_tool("benchmark", "--quick", "--resume", "-o", tmp_path)
    assert done.exit_code == 2
    assert words in done.stderr
    assert file.read_bytes() == before


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("--part", "speed"), "--part: found 'speed', expected one of projectors, solvers"),
        (("--resume", "--redo", "speed"), "--redo: found 'speed', expected one of"),
        (("--redo", "solvers"), "--redo: expected --resume"),
        (("--data", "nowhere"), "--data: nowhere/scalarflow/transforms.json: no such file"),
    ],
)
def test_bad_input_is_one_line(run_tool, stubs, tmp_path, arguments, words):
    done = run_tool("benchmark", *arguments, "-o", tmp_path / "out")
    assert done.exit_code == 2
    assert [line for line in done.stderr.splitlines() if line.startswith("error: ")] == [
        done.stderr.strip()
    ]
    assert words in done.stderr
    assert not stubs
    assert not (tmp_path / "out").exists()


def test_an_output_that_is_a_file(run_tool, stubs, tmp_path):
    (tmp_path / "out").write_text("x")
    done = run_tool("benchmark", "-o", tmp_path / "out")
    assert done.exit_code == 2
    assert "is a file, expected a folder" in done.stderr


def test_candidates_are_timed_in_turn(run_tool, monkeypatch):
    from _benchmark import timing

    clock = [0.0]
    monkeypatch.setattr(timing.time, "perf_counter", lambda: clock[0])
    calls = []
    spent = {"a": iter([9, 1, 5, 2]), "b": iter([9, 4, 4, 4])}

    def candidate(name):
        def run():
            calls.append(name)
            clock[0] += next(spent[name])

        return run

    found = timing.in_turn({name: candidate(name) for name in spent}, 3)
    assert "".join(calls) == "ab" * 4  # the first of each is not counted
    assert found == {"a": 2, "b": 4}


def test_a_paused_watch_stands_still(run_tool, monkeypatch):
    from _benchmark import timing

    clock = [0.0]
    monkeypatch.setattr(timing.time, "perf_counter", lambda: clock[0])
    watch = timing.Stopwatch()
    clock[0] = 2
    with watch.paused() as seconds:
        clock[0] = 50
    assert seconds == 2
    clock[0] = 51
    with watch.paused() as seconds:
        assert seconds == 3


@pytest.mark.parametrize(
    ("value", "text"),
    [
        (None, "–"),
        (float("inf"), "–"),
        (0.0, "0"),
        (7, "7"),
        (126000, "126,000"),
        (0.000123456, "0.000123"),
        (1.23456e-7, "1.23e-07"),
        (1234.5, "1,234"),
        (-0.5, "-0.500"),
    ],
)
def test_numbers_have_three_digits(run_tool, value, text):
    from _benchmark.tables import significant

    assert significant(value) == text


def test_numbers_stand_on_the_right(run_tool):
    from _benchmark.tables import number, table, words

    rows = [{"n": 1.5, "w": "32^3 voxels"}, {"n": None, "w": "2 threads"}]
    text = table(rows, [("n", number("n")), ("w", words("w"))])
    assert text.splitlines() == [
        "| n | w |", "|---:|---|", "| 1.50 | 32^3 voxels |", "| – | 2 threads |",
    ]  # fmt: skip


def test_an_aim_that_was_never_reached_is_not_met(run_tool):
    from _benchmark.claims import Claim, ratio

    assert not Claim("x", None, 5, at_least=False).met
    assert Claim("x", 5, 5, at_least=False).met
    assert not Claim("x", 4.9, 5).met
    assert ratio(None, 2) is ratio(2, None) is None
    assert ratio(3, 2) == 1.5


MEMORY = """
import json
import sys

import numpy as np

from _benchmark import memory_child

memory_child.forget_the_peak()
seen = [memory_child.peak_resident()]
block = np.ones(2**24, np.float32)  # 64 MiB
seen.append(memory_child.peak_resident())
del block
seen.append(memory_child.peak_resident())
memory_child.forget_the_peak()
seen.append(memory_child.peak_resident())
sys.stdout.write(json.dumps(seen))
"""


@pytest.mark.skipif(not Path("/proc/self/status").exists(), reason="no high-water mark")
def test_memory_given_back_is_not_counted():
    # in a process of its own, as the benchmark does: others' threads give memory back meanwhile
    done = subprocess.run(
        [sys.executable, "-c", MEMORY], cwd=TOOLS, capture_output=True, text=True, check=True
    )
    before, during, after, anew = json.loads(done.stdout)
    size = 2**26
    assert during - before == pytest.approx(size, rel=0.05)
    assert after == pytest.approx(during, abs=0.05 * size)  # the peak stays until it is forgotten
    assert anew == pytest.approx(before, abs=0.05 * size)
