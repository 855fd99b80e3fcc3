"""Damaged files through the commands, in this process: what they end with, take and write.

The tests run a few; ``PYTHONPATH=.:tests/rigs/recordings python tests/fuzz/verbs.py 5000`` runs
many under limits and reports.
"""

import contextlib
import json
import logging
import os
import random
import re
import resource
import shutil
import signal
import sys
import tempfile
import time
import traceback
import warnings
from collections import Counter
from dataclasses import dataclass
from pathlib import Path

import hypothesis.strategies as st
import numpy as np
import tifffile
from hypothesis import HealthCheck, Phase, given, seed, settings
from hypothesis.errors import HypothesisWarning
from mutations import BINARY, TREE, damaged
from samples import readers
from typer.testing import CliRunner

from phantoms import create
from rigs import ring, save_rig
from tomo import VoxelGrid
from tomo.cli.app import app
from tomo.simulation import simulate_images

GRID = VoxelGrid((6, 8, 6), 1.0)
VOXELS = ("--grid", "6x8x6", "--spacing", "1")
QUICK = ("--method", "sirt", "--iterations", "2", "--no-pictures")
VOLUMES, FILMS = "volume .", "film "


@dataclass(frozen=True)
class Case:
    """A file to damage, what lies beside it, and the command that is given it.

    ``arguments`` are those of the verb: ``{file}`` is the damaged file, ``{folder}`` its folder
    and ``{out}`` a folder to write into.
    """

    file: str
    samples: tuple
    changes: tuple
    others: dict
    arguments: tuple


@dataclass(frozen=True)
class Outcome:
    """What became of one command: its exit code and message, or the traceback of an exception."""

    code: int
    said: str
    trace: str
    seconds: float
    strays: tuple


def far_off(draw, content):
    """Multiply one number of a text, as a wrong unit, a slip or damage does."""
    numbers = list(re.finditer(rb"(?<![\w.])-?\d+\.?\d*(?:e[-+]?\d+)?", content))
    if not numbers:
        return content
    one = draw(st.sampled_from(numbers))
    factor = draw(st.sampled_from((0, -1, 1e-9, 1e-3, 0.5, 1.1, 3, 1e3, 1e6, 1e9, 1e30, 1e300)))
    return content[: one.start()] + repr(float(one[0]) * factor).encode() + content[one.end() :]


def cases(folder):
    """Return every case by name."""
    found = {}
    for name, reader in readers(folder).items():
        changes = (*reader.changes, far_off) if reader.changes is not BINARY else reader.changes
        about = (reader.file, reader.samples, changes, dict(reader.others))
        if name.startswith(VOLUMES):
            arguments = ("visualize-volume", "{file}", "-o", "{out}/a.png")
            spacing = ("--spacing", "1") if reader.file.endswith(".npy") else ()
            found[f"{name}, drawn"] = Case(*about, (*arguments, *spacing))
        elif not name.startswith((FILMS, "image", "notes", "calibration", "detection", "encoder",
                                  "checkpoint", "scan", "world", "ray table")):  # fmt: skip
            size = ("--image-size", "9x7")
            for given_to in ("{file}", "{folder}"):
                arguments = ("convert-rig", given_to, "{out}/new.yaml", *size)
                found[f"{name}, converted by {given_to[1:-1]}"] = Case(*about, arguments)
        if name in ("rig.yaml", "transforms.json"):
            found[f"{name}, checked"] = Case(*about, ("check-rig", "{file}", *VOXELS))
    return found | _scans(folder)


def _scans(folder):
    rig = ring(3, 60.0, 100.0, image_size=(12, 18), footprint=0.8)
    scan = folder / "scan"
    field = create("blobs", 1, GRID.extent, GRID.center)
    simulate_images(rig, field, GRID).save(scan)
    files = {
        str(path.relative_to(scan)): path.read_bytes()
        for path in scan.rglob("*")
        if path.is_file()
    }
    image = next(name for name in files if name.endswith(".tif"))
    found = {}
    for name, changes in (
        ("scan.yaml", (*TREE, far_off)),
        ("rig.yaml", (*TREE, far_off)),
        (image, BINARY),
    ):
        others = {other: content for other, content in files.items() if other != name}
        arguments = ("reconstruct", "{folder}", "-o", "{out}", *QUICK)
        kind = "image" if name == image else name
        found[f"{kind}, reconstructed"] = Case(name, (files[name],), changes, others, arguments)
    save_rig(rig, scan / "own.yaml")
    others = {"rig.yaml": (scan / "own.yaml").read_bytes()}
    levels = np.random.default_rng(0).integers(0, 999, (2, 2, 18, 12)).astype(np.uint16)
    made = []
    for settings_ in ({"ome": True, "metadata": {"axes": "TCYX"}}, {"imagej": True},
                      {"metadata": {"axes": "TCYX"}, "compression": "zlib"}):  # fmt: skip
        tifffile.imwrite(folder / "a.tif", levels, photometric="minisblack", **settings_)
        made.append((folder / "a.tif").read_bytes())
    others |= {f"films/{name}.tif": made[0] for name in rig.names[1:]}
    arguments = ("reconstruct", "--rig", "{folder}/rig.yaml", "--images", "{folder}/films")
    arguments += ("--channel", "1", "-o", "{out}", *VOXELS, *QUICK)
    file = f"films/{rig.names[0]}.tif"
    found["stack with channels, reconstructed"] = Case(
        file, tuple(made), BINARY, others, arguments
    )
    return found


def run(case, content, folder):
    """Return what becomes of a command that is given a damaged file."""
    shutil.rmtree(folder, ignore_errors=True)
    place, out = folder / "in", folder / "out"
    for name, data in {**case.others, case.file: content}.items():
        (place / name).parent.mkdir(parents=True, exist_ok=True)
        (place / name).write_bytes(data)
    out.mkdir()
    before = _contents(folder, out)
    names = {"file": str(place / case.file), "folder": str(place), "out": str(out)}
    began = time.process_time()  # waiting for a busy machine is no fault of the command
    with contextlib.chdir(place), warnings.catch_warnings(action="ignore"):
        done = CliRunner().invoke(app, [one.format(**names) for one in case.arguments])
    seconds = time.process_time() - began
    trace = ""
    if done.exception is not None and not isinstance(done.exception, SystemExit):
        trace = "".join(traceback.format_exception(done.exception))
    after = _contents(folder, out)
    strays = tuple(sorted(str(one) for one in before ^ after))
    return Outcome(done.exit_code, done.stderr, trace, seconds, strays)


def _contents(folder, out):
    """Return names and contents of all files but those below ``out``."""
    return {
        (path, path.read_bytes())
        for path in folder.rglob("*")
        if path.is_file() and out not in path.parents
    }


def tried(case, folder, count, number, tell):
    """Call ``tell`` with the outcome of ``count`` damaged files, the same for the same number."""

    @seed(number)
    @settings(max_examples=count, database=None, deadline=None, phases=[Phase.generate],
              suppress_health_check=list(HealthCheck))  # fmt: skip
    @given(damaged(case.samples, case.changes))
    def each(content):
        tell(content, run(case, content, folder))

    each()


def peak_memory():
    """Return the largest memory since `forget_peak`, in bytes; 0 where it is not known."""
    if not Path("/proc/self/clear_refs").exists():
        return 0
    said = Path("/proc/self/status").read_text()
    return int(said.partition("VmHWM:")[2].split(maxsplit=1)[0]) << 10


def forget_peak():
    """Begin anew with the largest memory."""
    if Path("/proc/self/clear_refs").exists():
        Path("/proc/self/clear_refs").write_text("5")


def _report(total, kept, memory=8 << 30, patience=120):
    """Run about ``total`` damaged files through all cases, and print what went wrong."""
    resource.setrlimit(resource.RLIMIT_AS, (memory, memory))
    signal.signal(signal.SIGALRM, lambda *_: (_ for _ in ()).throw(TimeoutError("too long")))
    warnings.simplefilter("ignore", HypothesisWarning)
    logging.disable()
    counts, worst = Counter(), {"seconds": (0, ""), "memory": (0, "")}
    number = random.Random(os.environ.get("SEED", "0")).randrange(2**32)
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        (folder / "samples").mkdir()
        every = {k: v for k, v in cases(folder / "samples").items() if kept in k}
        for kind, case in every.items():
            run(case, case.samples[0], folder / "run")  # compiles and imports

            def tell(content, outcome, kind=kind, case=case):
                signal.alarm(0)
                counts["mutants"] += 1
                counts[f"exit {outcome.code}"] += 1
                peak = peak_memory()
                worst["seconds"] = max(worst["seconds"], (outcome.seconds, kind))
                worst["memory"] = max(worst["memory"], (peak, kind))
                long, much = outcome.seconds > 20, peak > 2 << 30
                if outcome.trace or outcome.strays or long or much:
                    what = ("traceback", "stray", "time", "memory")
                    met = (outcome.trace, outcome.strays, long, much)
                    counts.update(word for word, is_met in zip(what, met, strict=True) if is_met)
                    kept_as = Path(tempfile.mkdtemp(prefix="mutant-")) / Path(case.file).name
                    kept_as.write_bytes(content)
                    about = f"{kind} {kept_as} {outcome.seconds:.0f} s {peak >> 20} MB"
                    sys.stdout.write(f"{about} {outcome.strays} {outcome.trace[-700:]}\n")
                    sys.stdout.flush()
                forget_peak()
                signal.alarm(patience)

            signal.alarm(patience)
            forget_peak()
            tried(case, folder / "run", max(total // len(every), 1), number, tell)
            signal.alarm(0)
    sys.stdout.write(json.dumps(counts | worst, indent=2) + "\n")


if __name__ == "__main__":
    _report(int(sys.argv[1]), sys.argv[2] if len(sys.argv) > 2 else "")
