"""A small simulated scan, and what the tests do to it."""

import shutil

import numpy as np
import pytest
import tifffile

from phantoms import create
from rigs import ring
from tomo import Scan, VoxelGrid, load_scan
from tomo.pipeline import Options, reconstruct
from tomo.simulation import simulate_images


@pytest.fixture(scope="session")
def grid():
    return VoxelGrid((10, 20, 10), 1.0, (1.0, -2.0, 0.5))


@pytest.fixture(scope="session")
def folder(tmp_path_factory, grid):
    """Return the scan that no test may change."""
    folder = tmp_path_factory.mktemp("simulated") / "scan"
    rig = ring(
        6,
        distance=200.0,
        image_size=(40, 60),
        footprint=0.5,
        center=grid.center,
        pitch_degrees=[10.0, -10.0] * 3,
    )
    field = create("jet", 1, grid.extent, grid.center)
    simulate_images(rig, field, grid, supersample=2, refine=2).save(folder)
    return folder


@pytest.fixture
def copy(folder, tmp_path):
    """Return a copy of the scan that the test may change."""
    shutil.copytree(folder, tmp_path / "scan")
    return tmp_path / "scan"


@pytest.fixture(scope="session")
def outcome(folder, choose_quickly, solve_quickly):
    with choose_quickly(), solve_quickly():
        return reconstruct(load_scan(folder))


@pytest.fixture(scope="session")
def volume_of():
    """Return a function that reconstructs a scan, or a folder, and returns the volume."""

    def run(scan, *arguments, **settings):
        scan = scan if isinstance(scan, Scan) else load_scan(scan)
        options = Options(**{"uncertainty": 0, **settings})  # which is found after the volume
        return reconstruct(scan, *arguments, options=options).solution.volume

    return run


@pytest.fixture(scope="session")
def far():
    """Return the largest difference of two volumes, relative to the largest emission."""
    return lambda volume, other: np.abs(volume - other).max() / other.max()


@pytest.fixture(scope="session")
def garble():
    """Return a function that fills an image, or a part of it, with noise."""

    def run(path, where=True):
        pixels = tifffile.imread(path)
        garbage = np.random.default_rng(5).random(pixels.shape, np.float32) * 5 * pixels.max()
        tifffile.imwrite(path, np.where(where, garbage, pixels))

    return run
