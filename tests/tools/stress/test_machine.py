"""The machine's rows, at the smallest size, and that they can fail."""

import signal
import subprocess
import sys
import time
from contextlib import suppress

import numpy as np
import pytest
from _stress import machine_kills, machine_results, machine_training, machine_writers
from _stress.machine_commands import Ended, small_scan
from _stress.machine_kind import Kind
from _stress.machine_kinds import KINDS
from _stress.row import Size, told

from tomo.io import read_volume, write_volume


def _idle(done, total, where):
    pass


@pytest.mark.parametrize("kind", ["vti", "checkpoint", "figures"])
def test_killed_writers_leave_the_last_good_state(tmp_path, kind):
    row = machine_kills.killed_writer(kind, tmp_path / kind, 3, 0)
    assert row.holds, row.note
    assert row.unit == "faults"


@pytest.mark.parametrize("name", ["ray table", "page", "meshes", "figures"])
def test_half_a_file_is_no_version(tmp_path, name):
    kind = KINDS[name]()
    kind.write(tmp_path, kind.prepare(), 7)
    assert kind.read(tmp_path) == {7}
    (path,) = tmp_path.iterdir()
    path.write_bytes(path.read_bytes()[: path.stat().st_size // 2])
    with suppress(ValueError):
        assert kind.read(tmp_path) in (set(), {-1})


def test_a_writer_that_writes_in_place_is_found_out(tmp_path):
    def write(folder, _, version):
        with (folder / "file").open("w") as file:
            for _ in range(50):
                file.write(f"{version}\n")
                file.flush()
                time.sleep(0.005)

    def read(folder):
        found = (folder / "file").read_text().split()
        return {int(line) for line in found} if len(found) == 50 else {-1}

    kind = Kind(write, read)
    found = machine_writers.kill_at_random(kind, tmp_path, 5, 0)
    assert found["faults"]


def test_killed_training_goes_on_to_the_same_bits(tmp_path):
    row = machine_kills.training(small_scan(tmp_path / "scan"), tmp_path, Size(quick=True), _idle)
    assert row.holds, row.note
    assert "the same bits" in row.note


def test_training_that_ends_elsewhere_is_a_fault(tmp_path):
    np.save(tmp_path / machine_training.VOLUME, np.zeros(3))
    assert machine_training.faults_of(0, tmp_path, np.zeros(3)) == []
    assert machine_training.faults_of(0, tmp_path, np.ones(3)) == ["another end"]
    assert machine_training.faults_of(1, tmp_path, np.zeros(3)) == ["exit code 1"]
    (tmp_path / ".checkpoint.partial-0-1-2.pt").touch()
    assert len(machine_training.faults_of(0, tmp_path, np.zeros(3))) == 1


STOPPED = """
import pathlib, signal, sys, time

out = pathlib.Path(sys.argv[1])


def stop(*_):
    {does}
    sys.stderr.write("terminated\\n")
    sys.exit(143)


signal.signal(signal.SIGTERM, stop)
time.sleep(30)
"""


@pytest.mark.parametrize(
    ("does", "fault"),
    [
        ("", ""),
        ("(out / 'report.json').unlink()", "report.json is missing"),
        ("(out / '.x.partial-0-1-2.npz').touch()", ".x.partial-0-1-2.npz"),
        ("sys.exit(1)", "exit code 1 without a word"),
        ("time.sleep(30)", "exit code -9 without a word"),
    ],
)
def test_a_stop_that_is_no_good_stop_is_found_out(tmp_path, monkeypatch, does, fault):
    def start(out, _):
        command = [sys.executable, "-c", STOPPED.format(does=does or "pass"), out]
        return subprocess.Popen(command, stderr=subprocess.PIPE)

    results = machine_results.Results(start, lambda out: machine_results.mixed(tmp_path, out))
    monkeypatch.setattr("_stress.machine_commands.LONGEST", 2.0)
    earlier, out = tmp_path / "earlier", tmp_path / "out"
    earlier.mkdir()
    (earlier / "report.json").write_text("{}")
    found = machine_kills.stopped_run(results, earlier, out, signal.SIGTERM, 143, 0.0)
    assert found == (fault, fault in ("", "report.json is missing", ".x.partial-0-1-2.npz"))


def test_a_note_tells_the_first_five_each_once():
    assert told(["a", "", "b", "a", "c", "d", "e", "f"]) == "a; b; c; d; e"


def test_every_end_that_is_no_good_end_is_a_fault():
    line = ("error: something",)
    assert Ended(0, (), 1.0).fault(0) == ""
    assert Ended(2, line, 1.0).fault(0, 2) == ""
    assert "traceback" in Ended(1, ("Traceback (most recent call last):", "x"), 1.0).fault(1)
    assert Ended(-11, (), 1.0).fault(0, 2) == "exit code -11 without a word"
    assert Ended(2, (*line, *line), 1.0).fault(2)
    assert Ended(1, line, 1.0).fault(0, 2)


def test_results_of_two_runs_in_one_folder_are_told_apart(run_tool, tmp_path):
    scan, out = small_scan(tmp_path / "scan"), tmp_path / "out"
    options = ("--method", "sirt", "--iterations", 1, "-o", out)
    assert run_tool("reconstruct", scan, *options).exit_code == 0
    assert machine_results.mixed(scan, out) == ""
    slices = out / "slices.png"
    slices.write_bytes(slices.read_bytes()[:-1])
    assert machine_results.mixed(scan, out) == "slices.png is of another run"
    volume, grid, unit = read_volume(out / "volume.vti")
    write_volume(out / "volume.vti", volume[::-1], grid, unit)
    assert machine_results.mixed(scan, out) == "volume.vti is of another run"
