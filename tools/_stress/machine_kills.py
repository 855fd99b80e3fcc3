"""Commands and writers that are killed, interrupted and started twice."""

from __future__ import annotations

import base64
import json
import math
import os
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from _stress.machine_commands import (
    ROOT,
    partial_files,
    run,
    start,
    told,
    volume_in,
    wait,
)
from _stress.machine_kinds import KINDS
from _stress.row import Progress, Row, Size

FULL = 20
"""Times that each writer, and training, is killed in a full run."""


def writers(folder: Path, size: Size, progress: Progress) -> Iterator[Row]:
    """Kill writers at random moments; the last good state has to load, and the next to work."""
    kinds = ("npz", "checkpoint", "scan") if size.quick else tuple(KINDS)
    for done, kind in enumerate(kinds):
        progress(done, len(kinds), f"kill -9: {kind}")
        yield killed_writer(kind, folder / "written" / kind, 3 if size.quick else FULL, size.seed)


def killed_writer(kind: str, folder: Path, times: int, seed: int) -> Row:
    """Kill the writer of one kind of file so many times."""
    folder.mkdir(parents=True)
    command = [sys.executable, "-m", "_stress.machine_writers", kind, folder, times, seed]
    done = subprocess.run(
        [str(part) for part in command],
        cwd=ROOT / "tools",
        env=_with_project(),
        capture_output=True,
        text=True,
        timeout=600,
    )
    if done.returncode:
        found = {"faults": [(done.stderr.strip().splitlines() or ["no word"])[-1][:100]]}
    else:
        found = json.loads(done.stdout)
    note = told(found["faults"])
    if not note:
        note = f"{found['left']} left a temporary file, removed by the next; {found['new']} done"
        if found["between"]:
            note += f"; {found['between']} while files were moved, which the folder says"
    return Row(f"kill -9 while writing: {kind}", f"{times} times, at random",
               len(found["faults"]), 0, "faults", note=note)  # fmt: skip


def training(scan: Path, folder: Path, size: Size, progress: Progress) -> Iterator[Row]:
    """Kill training and resume it, again and again: the end has to be the same, bit for bit."""
    times = 1 if size.quick else FULL
    out, random = folder / "training", np.random.default_rng(size.seed)
    rounds = 2 if size.quick else 4
    arguments = (scan, "--method", "wernet", "--iterations", rounds, "-o", out)
    whole = run("reconstruct", *arguments)
    if whole.code:
        yield Row("kill -9 in training", "", np.nan, 0, "faults", note=whole.fault(0))
        return
    expected, faults, killed, went_on = volume_in(out), [], 0, 0
    shutil.rmtree(out)
    while True:
        progress(killed, times, "kill -9: training")
        began = time.perf_counter()
        went_on += (out / "checkpoint.pt").exists()
        process = start("reconstruct", *arguments, "--resume")
        if killed < times:
            try:
                process.wait(whole.seconds * random.uniform(0.3, 1.0))
            except subprocess.TimeoutExpired:
                process.kill()
        end = wait(process, began)
        if end.code == -signal.SIGKILL:
            killed += 1
            continue
        same = end.code == 0 and np.array_equal(volume_in(out), expected)
        left = ", ".join(partial_files(out) if out.exists() else ())
        faults += [f for f in (end.fault(0) or left or ("" if same else "another end"),) if f]
        shutil.rmtree(out, ignore_errors=True)
        if killed >= times or len(faults) >= times:
            break
    if times >= FULL and not went_on:
        faults.append("none was killed late enough to go on from a checkpoint")
    yield Row(
        "kill -9 in training with wernet, then --resume",
        f"{killed} times, at random",
        len(faults),
        0,
        "faults",
        note=told(faults) or f"{went_on} went on from a checkpoint; each end the same bits",
    )


def signals(scan: Path, folder: Path, size: Size, progress: Progress) -> Iterator[Row]:
    """Interrupt and terminate commands at random moments."""
    times, random = 1 if size.quick else 8, np.random.default_rng(size.seed + 1)
    latest = 0.4 if size.quick else 0.8  # the only one has to come before the end
    arguments = ("reconstruct", scan, "--method", "auto", "-o")
    whole = run(*arguments, folder / "signals")
    kinds = (("Ctrl-C", signal.SIGINT, 130), ("SIGTERM", signal.SIGTERM, 143))
    for name, one, code in kinds[:1] if size.quick else kinds:
        faults, stopped = [], 0
        for number in range(times):
            progress(number, times, name)
            out = folder / f"{one}-{number}"
            shutil.copytree(folder / "signals", out)
            before = {path.name: path.read_bytes() for path in out.iterdir()}
            began = time.perf_counter()
            process = start(*arguments, out)
            time.sleep(whole.seconds * random.uniform(0.1, latest))
            process.send_signal(one)
            end = wait(process, began)
            fault = end.fault(0, code) or ", ".join(partial_files(out))
            if end.code == code:
                stopped += 1
                after = {path.name: path.read_bytes() for path in out.iterdir()}
                fault = fault or ("" if after == before else "the earlier result is changed")
            faults += [fault] if fault else []
            shutil.rmtree(out)
        if times > 1 and not stopped:
            faults.append("none was stopped")
        yield Row(f"{name} at random moments", f"{times} times", len(faults), 0, "faults",
                  note=told(faults) or f"{stopped} stopped, the others were done")  # fmt: skip


def two_runs(scan: Path, folder: Path, size: Size) -> Iterator[Row]:
    """Run two reconstructions into one folder at the same time."""
    times, faults = 1 if size.quick else 5, []
    for number in range(times):
        out = folder / f"two-{number}"
        began = time.perf_counter()
        options = [("--method", "sirt", "--iterations", n, "--seed", n) for n in (1, 40)]
        both = [start("reconstruct", scan, *option, "-o", out) for option in options]
        ends = [wait(process, began) for process in both]
        fault = told([end.fault(0) for end in ends]) or ", ".join(partial_files(out))
        faults += [f for f in (fault or mixed(scan, out),) if f]
    yield Row("two runs into one folder at the same time", f"{times} times", len(faults), 0,
              "faults", note=told(faults))  # fmt: skip


def mixed(scan: Path, out: Path) -> str:
    """Return what in a folder of results is not of the run that its report tells of."""
    from tomo.io import read_volume
    from tomo.metrics import cosine_distance

    distance = json.loads((out / "report.json").read_text("utf-8"))["quality"]["cosine_distance"]
    truth = read_volume(scan / "truth.npz")[0]
    page = (out / "report.html").read_text("utf-8")
    for kind in ("npz", "vti", "nrrd"):
        volume = read_volume(out / f"volume.{kind}")[0]
        if not math.isclose(cosine_distance(volume, truth), distance, rel_tol=1e-9):
            return f"volume.{kind} is of another run"
    for picture in out.glob("*.png"):
        if base64.b64encode(picture.read_bytes()).decode() not in page:
            return f"{picture.name} is of another run"
    return ""


def _with_project() -> dict[str, str]:
    return os.environ | {"PYTHONPATH": f"{ROOT}{os.pathsep}{ROOT / 'tools'}"}
