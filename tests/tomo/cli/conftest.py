"""A small scan to damage, and commands that have to refuse it in one line, exit code 2."""

import shutil

import pytest
import yaml

from phantoms import create
from rigs import ring
from tomo import VoxelGrid
from tomo.simulation import simulate_images

GRID = VoxelGrid((6, 10, 6), 1.0)


@pytest.fixture(scope="session")
def original(tmp_path_factory):
    """Return the folder of the scan that no test may change."""
    folder = tmp_path_factory.mktemp("original") / "scan"
    rig = ring(3, 60.0, 100.0, image_size=(12, 18), footprint=0.8)
    simulate_images(rig, create("blobs", 1, GRID.extent, GRID.center), GRID).save(folder)
    return folder


@pytest.fixture(scope="session")
def nothing_sought():
    """Return the options of a run that takes images and rig as they are."""
    return ("--no-screen", "--refine-cameras", "none", "--no-fit-gain", "--no-fit-absorption")


@pytest.fixture(scope="session")
def quick(nothing_sought):
    """Return the options of a run that looks for nothing and draws nothing."""
    words = "--method sirt --iterations 2 --uncertainty 0 --no-pictures"
    return (*words.split(), *nothing_sought)


@pytest.fixture
def scan(original, tmp_path):
    """Return a copy of the scan that the test may change."""
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
        bars = ("reconstruct ", "simulate ")
        lines = [one for one in done.stderr.splitlines() if not one.startswith(bars)]
        (line,) = filter(None, lines)
        assert line.startswith("error: ")
        assert done.stdout == ""
        assert _contents(tmp_path) == before
        return line

    return run


def _contents(folder):
    return {path: path.read_bytes() for path in folder.rglob("*") if path.is_file()} | {
        path: None for path in folder.rglob("*") if path.is_dir()
    }
