"""The fuzzing itself: it sees every kind of fault, and repeats bit by bit."""

import importlib
import io
import json
import subprocess
import sys
import zipfile
from pathlib import Path
from random import Random

import numpy as np
import pytest
from _stress import fuzzing_area, fuzzing_coverage
from _stress.fuzzing_child import Report
from _stress.fuzzing_containers import change_png, change_zip, zip_bomb
from _stress.fuzzing_mutations import BINARY, LARGEST, TEXT, TREE, mutated
from _stress.fuzzing_readers import NAMES, OFTEN
from _stress.row import Size

TOOLS = Path(__file__).parents[3] / "tools"

# An audit hook stays for as long as its process: the watched readers are in one of their own.
WATCHED = f"""
import json, os, pathlib, pickle, sys
sys.path[:0] = [{str(TOOLS)!r}, {str(TOOLS.parent)!r}]
from _stress.fuzzing_containers import pickles
from _stress import fuzzing_guard

path = pathlib.Path(sys.argv[1]) / "file"
path.write_bytes(b"x = [1]")

def raises(error):
    def read(path):
        raise error
    return read

def waits(path):
    while True:
        try:
            sum(range(1000))
        except Exception:
            pass

READERS = dict(
    good=lambda path: path.read_bytes(),
    refused=raises(ValueError("one line")),
    absent=lambda path: path.with_name("none").read_bytes(),
    two_lines=raises(ValueError("two\\nlines")),
    silent=raises(ValueError("")),
    key=raises(KeyError("x")),
    deep=raises(RecursionError()),
    large=lambda path: bytearray(b"x") * (300 << 20),
    writes=lambda path: path.with_name("other").write_bytes(b""),
    moves=lambda path: os.rename(path, path),
    runs=lambda path: exec(path.read_text()),
    unpickles=lambda path: pickle.loads(pickles()[0]),
    calls=lambda path: os.system("true"),
    hangs=waits,
)
guard, faults = fuzzing_guard.Guard(), {{}}
for name, read in READERS.items():
    fuzzing_guard.LIMIT = 0.1 if name == "hangs" else 2.0
    faults[name] = guard.watch(read, path, 7).fault
print(json.dumps(faults))
"""


def test_every_kind_of_fault_is_seen(tmp_path):
    done = subprocess.run(
        [sys.executable, "-c", WATCHED, str(tmp_path)],
        cwd=tmp_path,
        capture_output=True,
        check=True,
        text=True,
    )
    faults = json.loads(done.stdout)
    assert [name for name, fault in faults.items() if not fault] == ["good", "refused", "absent"]
    for name, words in {
        "two_lines": "2 lines",
        "silent": "0 lines",
        "key": "KeyError",
        "deep": "RecursionError",
        "large": "MB beyond",
        "writes": "wrote",
        "moves": "wrote: os.rename",
        "runs": "executed",
        "unpickles": "executed",
        "calls": "executed: os.system",
        "hangs": "TooLong",
    }.items():
        assert words in faults[name]


@pytest.mark.parametrize("mutations", [TEXT, TREE, BINARY, (change_zip, change_png)])
def test_a_seed_gives_the_same_inputs(mutations):
    file = io.BytesIO()
    np.savez(file, a=np.arange(3))
    seeds = (b"a: 1\nb: [1, 2]\n", b'{"a": {"b": [1.5, null]}}', file.getvalue(), b"\x89PNG")

    def inputs(seed):
        rng = Random(seed)
        return [mutated(rng.choice(seeds), rng, seeds, mutations) for _ in range(300)]

    assert inputs(0) == inputs(0) != inputs(1)
    assert len(set(inputs(0))) > 150
    assert max(map(len, inputs(0))) <= LARGEST


def test_a_bomb_is_an_archive_that_unpacks_to_much():
    bomb = zip_bomb({"a.npy": b"x"}, "b.npy", b"head", 3 << 20)
    with zipfile.ZipFile(io.BytesIO(bomb)) as archive:
        assert archive.testzip() is None
        assert archive.read("b.npy") == b"head" + bytes(3 << 20)
    assert len(bomb) < (3 << 20) / 500


NOTED = '''"""A module."""

from __future__ import annotations


def compiled():
    return lambda function: function


@compiled()
def kernel(n):
    return n


class Named:
    """With a docstring."""

    def __init__(self, n):
        """With another."""
        self.n = n


def kind(n):
    try:
        if n > 0:
            return Named(n)
        elif n == 0:
            return None
    finally:
        kernel(n)
    match n:
        case -1:
            raise ValueError("one line")
    return n
'''


def test_statements_are_counted_as_they_are_reached(tmp_path, monkeypatch):
    (tmp_path / "noted.py").write_text(NOTED, "utf-8")
    coverage = fuzzing_coverage.Coverage()
    monkeypatch.setattr(fuzzing_coverage, "PACKAGES", ("noted",))
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.setattr(sys, "meta_path", [coverage, *sys.meta_path])
    noted = importlib.import_module("noted")
    monkeypatch.delitem(sys.modules, "noted")
    assert coverage.statements == 6  # five definitions, and what `compiled` returns
    coverage.forget()
    counts = []
    for n in (0, 0, 1, -2):
        noted.kind(n)
        counts.append(coverage.statements)
    assert counts == [5, 5, 7, 9]
    with pytest.raises(ValueError, match="one line") as error:
        noted.kind(-1)
    assert coverage.statements == 10
    line = error.traceback[-1].lineno
    assert NOTED.splitlines()[line].strip().startswith("raise")
    assert "__reached__" not in noted.kernel.__code__.co_names
    assert noted.Named.__doc__ == "With a docstring."
    assert not list(tmp_path.glob("**/*.pyc"))


def test_readers_have_nothing_to_hide():
    names = ("Middlebury", "volume .vti")
    reports = fuzzing_area.run(names, 40)
    assert set(OFTEN) < set(NAMES)
    for name in names:
        report = reports[name]
        assert report["faults"] == {}
        assert report["inputs"] == 40 * (1 + (name in OFTEN))
        assert report["statements"] > 30
    again = fuzzing_area.run(names, 40)
    assert [again[name]["statements"] for name in names] == [
        reports[name]["statements"] for name in names
    ]


def test_a_process_that_ends_is_a_fault_and_another_goes_on(monkeypatch):
    asked = []

    def ask(self, job):
        asked.append(job["inputs"])
        report = Report(job["reader"], job["inputs"] if len(asked) > 1 else 3)
        return vars(report), "" if len(asked) > 1 else "crashed: exit code -11"

    monkeypatch.setattr(fuzzing_area._Child, "_ask", ask)
    report = fuzzing_area.run(("MyPTV",), 10)["MyPTV"]
    assert asked == [10, 6]
    assert report["inputs"] == 10
    assert report["faults"] == {"crashed: exit code -11": 1}


def test_rows_count_faults_by_kind(monkeypatch):
    faults = {"wrote 'x'": 1, "executed: x": 2, "crashed: x": 3, "KeyError: x": 4}
    faults |= {"TooLong: x": 5, "300 MB beyond four times the file": 6}

    def run(names, inputs, seed, progress):
        clean = {
            "inputs": inputs,
            "statements": 1,
            "slowest": 1.0,
            "memory": 5 << 20,
            "faults": {},
        }
        reports = {name: {"reader": name, **clean} for name in names}
        reports["MyPTV"] |= {"faults": faults, "slowest": 3.0, "memory": 300 << 20}
        return reports

    monkeypatch.setattr(fuzzing_area, "run", run)
    rows = {row.stress: row for row in fuzzing_area.rows(Size(quick=True), lambda *_: None)}
    assert rows["Reader of MyPTV"].figure == 21
    assert rows["Inputs in all"].holds
    missed = {name: row.figure for name, row in rows.items() if not row.holds}
    assert missed == {
        "Reader of MyPTV": 21,
        "Files written by readers": 1,
        "Code executed from files": 2,
        "Processes that crashed or hung": 3,
        "Errors other than one line of ValueError or OSError": 4,
        "Slowest reading": 3.0,
        "Most memory beyond four times the file": 300,
    }
