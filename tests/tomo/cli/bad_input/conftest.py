"""A small scan to damage, and commands that have to refuse it in one line."""

import shutil
import subprocess
import sys
from pathlib import Path

import pytest
import yaml

from phantoms import create
from rigs import ring
from tomo import VoxelGrid
from tomo.simulation import simulate_images

TOOLS = Path(__file__).parents[4] / "tools"
GRID = VoxelGrid((6, 10, 6), 1.0)


@pytest.fixture(scope="module")
def original(tmp_path_factory):
    folder = tmp_path_factory.mktemp("original") / "scan"
    rig = ring(3, 60.0, 100.0, image_size=(12, 18), footprint=0.8)
    simulate_images(rig, create("blobs", 1, GRID.extent, GRID.center), GRID).save(folder)
    return folder


@pytest.fixture
def scan(original, tmp_path):
    shutil.copytree(original, tmp_path / "scan")
    return tmp_path / "scan"


@pytest.fixture
def edit():
    """Return a function that changes what a YAML file holds."""

    def run(path, change):
        data = yaml.safe_load(path.read_text("utf-8"))
        change(data)
        path.write_text(yaml.safe_dump(data), "utf-8")

    return run


@pytest.fixture
def refused(run_tool, tmp_path):
    """Return a function that runs a command on bad input and returns the line it says."""

    def run(tool, *arguments):
        before = _contents(tmp_path)
        done = run_tool(tool, *arguments)
        assert done.exit_code == 2, (done.stderr, done.exception)
        line = _the_one_line(done.stderr)
        assert done.stdout == ""
        assert _contents(tmp_path) == before
        return line

    return run


@pytest.fixture
def refused_by_a_process(tmp_path):
    """Return the same with a process of its own."""

    def run(tool, *arguments):
        before = _contents(tmp_path)
        command = [sys.executable, TOOLS / tool, *arguments]
        done = subprocess.run(command, capture_output=True, text=True, timeout=120, check=False)
        assert done.returncode == 2
        assert done.stdout == ""
        assert _contents(tmp_path) == before
        return _the_one_line(done.stderr)

    return run


def _the_one_line(stderr):
    bars = ("reconstruct ", "simulate ")
    lines = [line for line in stderr.splitlines() if line.strip() and not line.startswith(bars)]
    assert len(lines) == 1, stderr
    assert lines[0].startswith("error: ")
    return lines[0]


def _contents(folder):
    return {path: path.read_bytes() for path in folder.rglob("*") if path.is_file()} | {
        path: None for path in folder.rglob("*") if path.is_dir()
    }
