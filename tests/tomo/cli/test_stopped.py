"""Commands that lack disk or memory or were killed: one line, nothing half-written."""

import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import torch

ROOT = Path(__file__).parents[3]


def _lines(stderr):
    bars = ("reconstruct ", "simulate ")
    lines = [line for line in stderr.splitlines() if line.strip()]
    return [line for line in lines if not line.startswith(bars)]


def _limited(limit, value, *arguments):
    """Run reconstruct with one of the system's limits.

    It writes no compiled modules (-B): a limit on files would leave halves of them behind.
    """
    code = (
        "import os, resource, sys\n"
        f"resource.setrlimit(resource.RLIMIT_{limit}, ({value}, {value}))\n"
        "os.execv(sys.executable, [sys.executable, '-B', *sys.argv[1:]])"
    )
    command = [sys.executable, "-c", code, ROOT / "tools" / "reconstruct.py", *arguments]
    return subprocess.run(
        list(map(str, command)),
        cwd=ROOT,
        env=os.environ | {"PYTHONPATH": str(ROOT)},
        capture_output=True,
        text=True,
    )


def test_a_full_disk_is_one_line_that_names_the_file(run_tool, original, quick, tmp_path):
    out = tmp_path / "out"
    # compiled code is on disk before there is a limit
    run_tool("reconstruct", original, *quick, "-o", tmp_path / "before")
    out.mkdir()
    (out / "report.json").write_text("{}")
    done = _limited("FSIZE", 3000, original, *quick, "-o", out)
    assert done.returncode == 1
    assert len(_lines(done.stderr)) == 1, done.stderr
    assert f"error: {out}" in done.stderr
    assert ": File too large" in done.stderr
    assert {path.name for path in out.iterdir()} == {"report.json", "preview.npz"}


def test_less_address_space_than_the_libraries_take_is_one_line(original, quick, tmp_path):
    done = _limited("AS", 900_000_000, original, *quick, "-o", tmp_path / "out")
    assert done.returncode == 2
    (line,) = _lines(done.stderr)
    assert line.startswith("error: memory: found an address space of 0.9 GB (ulimit -v)")


@pytest.mark.parametrize(
    "lack",
    [
        MemoryError("Unable to allocate 8.00 GiB"),
        RuntimeError("DefaultCPUAllocator: can't allocate memory: you tried 8 bytes"),
        RuntimeError("a defect"),
    ],
    ids=["numpy", "torch", "defect"],
)
def test_memory_that_runs_out_is_one_line_and_a_defect_is_not_hidden(
    run_tool, original, quick, tmp_path, monkeypatch, lack
):
    def fail(*_, **__):
        raise lack

    monkeypatch.setattr("tomo.reconstruct", fail)
    done = run_tool("reconstruct", original, *quick, "-o", tmp_path / "out")
    if str(lack) == "a defect":
        assert done.exception is lack
        return
    assert done.exit_code == 2
    (line,) = _lines(done.stderr)
    assert line.startswith("error: memory: found too little left")


def test_what_a_killed_run_left_is_removed_by_the_next(run_tool, original, quick, tmp_path):
    code = (
        "import os, signal, sys\n"
        "from rigs.files import atomic_path\n"
        "with atomic_path(sys.argv[1]) as temporary:\n"
        "    temporary.write_text('half')\n"
        "    os.kill(os.getpid(), signal.SIGKILL)\n"
    )
    subprocess.run([sys.executable, "-c", code, tmp_path / "checkpoint.pt"], cwd=ROOT)
    assert len(list(tmp_path.iterdir())) == 1
    done = run_tool("reconstruct", original, *quick, "-o", tmp_path)
    assert done.exit_code == 0
    assert not [path.name for path in tmp_path.iterdir() if path.name.startswith(".")]


def test_training_that_diverges_at_once_is_one_line(run_tool, original, quick, tmp_path):
    from tomo.wernet import Encoder, save_encoder

    encoder = Encoder("relative", seed=0)
    with torch.no_grad():
        for parameter in encoder.parameters():
            parameter.fill_(float(np.finfo(np.float32).max))
    save_encoder(encoder, tmp_path / "encoder.pt")
    how = tmp_path / "how.yaml"
    how.write_text("encoder: encoder.pt\n")
    options = (*quick[2:], "--method", "wernet-paper", "--wernet-settings", how)
    done = run_tool("reconstruct", original, *options, "-o", tmp_path / "out")
    assert done.exit_code == 1
    *_, line = _lines(done.stderr)
    assert line.startswith("error: wernet-paper: epoch 1: loss: found NaN or infinity")
    assert not list((tmp_path / "out").glob("volume*"))
