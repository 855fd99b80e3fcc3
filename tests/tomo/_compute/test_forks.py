"""Processes that are forked after a reconstruction: none hangs, and only compiled loops refuse."""

import multiprocessing
import os
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[3]

POOL = """
import multiprocessing, sys
import numpy as np
import rigs
from tomo import Options, Scan, VoxelGrid, reconstruct

def total(seed):
    rig = rigs.ring(4, distance=200.0, image_size=(16, 16), footprint=0.8)
    images = {name: np.random.default_rng(seed).random((16, 16)) for name in rig.names}
    scan = Scan.from_arrays(rig, images, VoxelGrid((8, 8, 8), 1.0))
    options = Options(
        method="sirt", iterations=2, uncertainty=0, screen=False, refine_cameras="none",
        fit_gain=False, fit_absorption=False,
    )
    return float(reconstruct(scan, options=options).volume.sum())

def double(number):
    return 2 * number

if __name__ == "__main__":
    here = total(1)
    for how in ("fork", "spawn"):
        with multiprocessing.get_context(how).Pool(1) as pool:
            print(pool.map_async(double, [21]).get(60)[0])
            try:
                print(pool.map_async(total, [1]).get(60)[0] == here)
            except RuntimeError as error:
                print(error)
"""


@pytest.mark.skipif(
    "fork" not in multiprocessing.get_all_start_methods(), reason="this system does not fork"
)
def test_a_pool_after_a_reconstruction_works_or_says_what_does(tmp_path):
    script = tmp_path / "pool.py"
    script.write_text(POOL)
    run = subprocess.run(
        [sys.executable, script], capture_output=True, text=True, timeout=200, cwd=tmp_path,
        env=os.environ | {"PYTHONPATH": str(ROOT)},
    )  # fmt: skip
    assert run.returncode == 0, run.stderr
    forked, found, spawned, same = run.stdout.splitlines()
    assert (forked, spawned, same) == ("42", "42", "True")
    assert found == "True" or "get_context('spawn')" in found
