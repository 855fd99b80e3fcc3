"""Runs that end at random moments go on to the bits of an undisturbed one."""

import os
import random
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

from tomo.series import SeriesStore

ROOT = Path(__file__).parents[3]

RUNS = """
import os, signal, sys
import numpy as np
import rigs, tomo.selection
from tomo import Options, Scan, VoxelGrid
from tomo.cli.stopping import run
from tomo.series import reconstruct_series
with np.load(sys.argv[1]) as file:
    images = dict(file)
rig = rigs.ring(5, distance=200.0, image_size=(24, 26), footprint=0.8, pitch_degrees=12.0)
scan = Scan.from_arrays(rig, images, VoxelGrid((12, 14, 12), 1.0))
quick = Options(
    frames=":", hold_out=(rig.names[2],), key_frames=2, method="sirt", iterations=40,
    screen=False, refine_cameras="none", fit_gain=False, fit_absorption=False,
)
for line in sys.stdin:  # each run is a process of its own; what it imports is here already
    child = os.fork()
    if not child:
        signal.signal(signal.SIGINT, signal.default_int_handler)
        run(lambda: reconstruct_series(scan, line.strip(), options=quick))
        os._exit(0)
    print(child, flush=True)
    print(os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]), flush=True)
"""


@pytest.fixture
def runs(film, tmp_path):
    """Return a function that begins a run on a store; it returns its number and how it ends."""
    np.savez(tmp_path / "images.npz", **film.images)
    process = subprocess.Popen(
        [sys.executable, "-c", RUNS, str(tmp_path / "images.npz")],
        cwd=ROOT, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True,
        env=os.environ | {"NUMBA_NUM_THREADS": "1", "OMP_NUM_THREADS": "1"},
    )  # fmt: skip

    def begin(path):
        process.stdin.write(f"{path}\n")
        process.stdin.flush()
        return int(process.stdout.readline()), lambda: int(process.stdout.readline())

    with process:
        yield begin
        process.stdin.close()


@pytest.mark.skipif(not hasattr(os, "fork"), reason="the runs are forked")
def test_runs_ended_at_random_moments_go_on_to_the_same_bits(runs, tmp_path, assert_same):
    path, other = tmp_path / "out.zarr", tmp_path / "undisturbed.zarr"
    assert runs(other)[1]() == 0
    rng = random.Random(36)
    ends = []
    for number in (signal.SIGKILL, signal.SIGINT):
        wanted = rng.randrange(0, 4) + 4 * len(ends)
        child, end = runs(path)
        limit = time.monotonic() + 60
        while len(list(path.glob("emission/c/*"))) < wanted and time.monotonic() < limit:
            time.sleep(0.001)
        time.sleep(rng.uniform(0, 0.05))
        os.kill(child, number)
        ends.append(end())
    assert ends == [-9, 130]
    assert runs(path)[1]() == 0
    assert_same(SeriesStore(path), SeriesStore(other))
    assert not list(path.rglob("*.partial"))
