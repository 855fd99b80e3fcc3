"""Writers that are killed at a random moment leave what was there, or what they wrote, whole."""

import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

from rigs.files import remove_leftovers
from tomo import load_scan
from tomo.io import read_volume

ROOT = Path(__file__).parents[3]
TIMES = 2

WRITES = """
import sys
from itertools import count
from pathlib import Path

import numpy as np

from rigs import ring
from tomo import VoxelGrid
from tomo.io import write_volume
from tomo.scan import save_scan

folder, first = Path(sys.argv[1]), int(sys.argv[2])
grid = VoxelGrid((40, 40, 40), 0.5)
texture = np.random.default_rng(0).random(grid.shape).astype(np.float32) / 2
for version in count(first):
    for suffix in (".npz", ".vti", ".nrrd"):
        write_volume(folder / f"volume{suffix}", texture + version, grid)
    rig = ring(6, distance=100.0 + version, image_size=(80, 60), footprint=0.5)
    images = {name: np.full((60, 80), version, np.float32) for name in rig.names}
    truth = np.full(grid.shape, version, np.float32)
    save_scan(folder / "scan", rig, {"0001": images}, grid=grid, truth=truth)
    print(version, flush=True)
"""


def versions_in(folder):
    """Return the versions of each volume and of the scan; half a file cannot be read."""
    found = {}
    for suffix in (".npz", ".vti", ".nrrd"):
        values = read_volume(folder / f"volume{suffix}")[0]
        found[suffix] = {int(value) for value in np.unique(np.floor(values))}
    if (folder / "scan" / "scan.yaml").exists():  # else the folder says that it is not complete
        scan = load_scan(folder / "scan")
        values = {float(value) for image in scan.images() for value in np.unique(image)}
        values |= {float(value) for value in np.unique(read_volume(scan.truth)[0])}
        values |= {round(float(np.linalg.norm(c.position))) - 100.0 for c in scan.rig}
        found["scan"] = {int(value) for value in values}
    return found


@pytest.mark.skipif(sys.platform == "win32", reason="no SIGKILL")
def test_a_writer_killed_at_a_random_moment_leaves_every_file_whole(tmp_path):
    random, done = np.random.default_rng(), 1
    for _ in range(TIMES):
        command = [sys.executable, "-c", WRITES, str(tmp_path), str(done)]
        writer = subprocess.Popen(command, cwd=ROOT, stdout=subprocess.PIPE, text=True)
        done = int(writer.stdout.readline())  # everything has been written once
        time.sleep(random.uniform(0.0, 0.3))
        writer.kill()
        rest, _ = writer.communicate()
        done = max([done, *map(int, rest.split())])
        for name, versions in versions_in(tmp_path).items():
            assert len(versions) == 1, name
            assert versions <= {done, done + 1}, name
        done += 1
    for folder in (tmp_path, tmp_path / "scan"):
        remove_leftovers(folder)
    assert not [path for path in tmp_path.rglob(".*") if ".partial-" in path.name]
