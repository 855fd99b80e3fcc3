"""Which libraries a verb loads: those that it needs, so that it starts in a second."""

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

from rigs import ring, save_rig
from tomo.cli.app import VERBS

ROOT = Path(__file__).resolve().parents[3]
SLOW_TO_LOAD = {"cv2", "matplotlib", "numba", "open3d", "plotly", "scipy", "torch", "trimesh"}

RUN = """
import json, sys
from tomo.cli.app import app

loaded = []
for line in json.loads(sys.argv[1]):
    code = 0
    try:
        app(line, prog_name="flametomo")
    except SystemExit as end:
        code = end.code
    loaded.append((line[0], code, sorted({name.partition(".")[0] for name in sys.modules})))
with open("loaded.json", "w") as file:
    json.dump(loaded, file)
"""


def loaded_by(lines, folder):
    """Yield verb, exit code and the libraries loaded so far, after each command of one process."""
    subprocess.run(
        [sys.executable, "-c", RUN, json.dumps(lines)],
        cwd=folder,
        env={**os.environ, "PYTHONPATH": str(ROOT)},
        check=True,
        capture_output=True,
    )
    for verb, code, names in json.loads((folder / "loaded.json").read_text()):
        yield verb, code, set(names)


def test_the_help_of_every_verb_loads_nothing_slow(tmp_path):
    lines = [["--help"], *([verb, "--help"] for verb in VERBS)]
    for verb, code, names in loaded_by(lines, tmp_path):
        assert code == 0
        assert "typer" in names
        assert not names & SLOW_TO_LOAD, verb
        assert "numpy" not in names or verb != "--help"


@pytest.fixture
def folder(tmp_path):
    save_rig(ring(3, distance=200, image_size=(8, 10), footprint=1.0), tmp_path / "rig.yaml")
    return tmp_path


def test_verbs_that_need_neither_open3d_nor_torch_load_neither(folder):
    box = ["--grid", "4x6x4", "--spacing", "1"]
    lines = [
        ["convert-rig", "rig.yaml", "transforms.json"],
        ["check-rig", "rig.yaml", *box],
        ["simulate", "--rig", "rig.yaml", "--phantom", "jet", *box, "--frames", "2", "-o", "scan"],
        ["reconstruct", "scan", "--frames", ":", "--method", "sirt", "--iterations", "2",
         "--refine-cameras", "none", "--no-fit-absorption", "-o", "film.zarr"],
        ["export", "film.zarr", "--to", "npz", "-o", "volumes"],
        ["visualize-volume", "film.zarr", "-o", "film.html"],
        ["visualize-rig", "rig.yaml", "-o", "rig.html"],
    ]  # fmt: skip
    for verb, code, names in loaded_by(lines, folder):
        assert code == 0, verb
        assert "numpy" in names
        assert not names & {"open3d", "torch"}, verb
