"""What a command shows before it is done, and what it leaves where it is stopped."""

import json
import os
import re
import signal
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import tomo
from tomo.io import read_volume

ROOT = Path(__file__).parents[3]
PREVIEW = {"preview.npz", "preview.json"}
VOLUMES = {"volume.npz", "volume.vti", "volume.nrrd"}

STOPPED = """
import json, os, signal, sys
from importlib import import_module

from tomo.cli.app import app
from tomo.cli.stopping import run

stages = import_module("tomo.pipeline.reconstruct")


def stopped(name, calls, words):
    function = getattr(stages, name)

    def counted(*values, **named):
        nonlocal calls
        calls -= 1
        if calls == 0:
            os.kill(os.getpid(), signal.SIGINT)
        return function(*values, **named)

    setattr(stages, name, counted)
    run(lambda: app(["reconstruct", *words]))


for *where, words, said in json.loads(sys.argv[1]):
    child = os.fork()  # each run is a process of its own; what it imports is here already
    if not child:
        os.dup2(os.open(said, os.O_WRONLY | os.O_CREAT), 2)
        stopped(*where, words)
    print(os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]))
"""


@pytest.fixture(scope="module")
def done(run_tool, original, tmp_path_factory, choose_quickly, nothing_sought):
    """Return the folder and the result of a run to the end."""
    out = tmp_path_factory.mktemp("out")
    with choose_quickly():
        result = run_tool("reconstruct", original, *nothing_sought, "-o", out)
    assert result.exit_code == 0, result.stderr
    return out, result


def test_lines_come_in_the_order_of_the_work(done):
    out, result = done
    lines = result.stderr.splitlines()
    report = json.loads((out / "report.json").read_text())
    began = (
        "Preview (nothing corrected): ", "preview.npz is complete after ",
        f"open {out / 'preview.png'}", "volume.npz is complete after ",
        report["answer"]["sentence"], f"open {out / 'report.html'}",
    )  # fmt: skip
    found = [[n for n, line in enumerate(lines) if line.startswith(words)] for words in began]
    places = [min(one) for one in found]
    assert places == sorted(places)
    stages = [n for n, line in enumerate(lines) if line.startswith("reconstruct")]
    later = [n for n in stages if ": how far to trust it" in lines[n] or ": pictures" in lines[n]]
    assert len(later) >= 2
    assert min(later) > places[3]
    assert not list(out.glob("preview*"))


def test_stages_after_the_preview_tell_what_is_left(done):
    _, result = done
    stages = [line for line in result.stderr.splitlines() if line.startswith("reconstruct ")]
    preview = next(n for n, line in enumerate(stages) if line.endswith(": preview"))
    assert not any(" left)" in line for line in stages[: preview + 1])
    left = re.compile(r"reconstruct [\d:]+ \(\d+ %, \d+:\d\d left\): ")
    assert all(left.match(line) for line in stages[preview + 1 :])


def test_a_preview_stops_there(run_tool, original, tmp_path):
    (tmp_path / "report.json").write_text("{}")  # of an earlier run
    result = run_tool("reconstruct", original, "--preview", "-o", tmp_path, "--json")
    assert result.exit_code == 0
    names = {path.name for path in tmp_path.iterdir()}
    assert names == {"preview.npz", "preview.json", "preview.png", "report.json"}
    report = json.loads(result.stdout)
    assert report == json.loads((tmp_path / "preview.json").read_text())
    assert report["preview"] == 1
    assert report["answer"]["sentence"] in result.stderr.splitlines()
    volume, grid, unit = read_volume(tmp_path / "preview.npz")
    assert (grid.shape, unit) == ((6, 10, 6), "mm")
    np.testing.assert_array_equal(volume, tomo.preview(original).volume)
    assert (tmp_path / "preview.png").read_bytes().startswith(b"\x89PNG")
    assert result.stderr.splitlines()[-1] == f"open {tmp_path / 'preview.png'}"


def test_a_film_has_no_preview(refused, original, tmp_path):
    asked = ("--preview", "--frames", ":", "-o", tmp_path / "out.zarr")
    line = refused("reconstruct", original, *asked)
    assert line == "error: --preview: found it with --frames, expected one of both"


STOPS = {
    ("check_options", 1): ({"report.json"}, ""),
    ("cameras_to_refine", 1): ({*PREVIEW, "report.json"}, "; {out}/preview.npz is complete, "),
    # the first is the preview's
    ("assess", 2): ({*PREVIEW, *VOLUMES}, "; {out}/volume.npz is complete, without intervals"),
}


@pytest.mark.skipif(not hasattr(os, "fork"), reason="the runs are forked")
def test_a_stop_leaves_what_is_complete_and_says_so(original, quick, tmp_path):
    runs = []
    for stage, call in STOPS:
        out = tmp_path / stage
        out.mkdir()
        (out / "report.json").write_text("{}")  # of an earlier run
        words = list(map(str, (original, "-o", out, *quick)))
        runs.append((stage, call, words, f"{out}.txt"))
    before = signal.signal(signal.SIGINT, signal.default_int_handler)  # else it is ignored there
    done = subprocess.run(
        [sys.executable, "-c", STOPPED, json.dumps(runs)],
        cwd=ROOT,
        stdout=subprocess.PIPE,
        text=True,
        timeout=120,
    )
    signal.signal(signal.SIGINT, before)
    assert done.stdout.split() == ["130"] * len(STOPS)
    for (stage, _), (left, words) in STOPS.items():
        out = tmp_path / stage
        last = Path(f"{out}.txt").read_text().splitlines()[-1]
        assert last.startswith("interrupted" + words.format(out=out))
        assert {path.name for path in out.iterdir()} == left
        for name in left & {"preview.npz", "volume.npz"}:
            assert read_volume(out / name)[1].shape == (6, 10, 6)
