"""A small scan folder that a test may spoil, and what is in it."""

import numpy as np
import pytest
import yaml

from rigs import Camera, Rig
from rigs.camera import look_at
from tomo import VoxelGrid
from tomo.scan import save_scan

SIZES = {"left": (7, 5), "right": (9, 8)}  # (width, height)


def camera(name, position):
    R, t = look_at(position, (0, 0, 0))
    width, height = SIZES[name]
    K = np.array([[50.0, 0, (width - 1) / 2], [0, 50, (height - 1) / 2], [0, 0, 1]])
    return Camera(name, SIZES[name], K, R=R, t=t)


def random_images(seed):
    random = np.random.default_rng(seed)
    return {n: random.random((h, w)).astype(np.float32) for n, (w, h) in SIZES.items()}


@pytest.fixture(scope="session")
def rig():
    return Rig((camera("left", (100.0, 0, 0)), camera("right", (0, 10.0, 100.0))))


@pytest.fixture(scope="session")
def grid():
    return VoxelGrid((2, 3, 4), 0.5, (0.0, 1.0, 2.0))


@pytest.fixture
def frames():
    return {"first": random_images(0), "second": random_images(1)}


@pytest.fixture
def folder(tmp_path, rig, frames, grid):
    save_scan(tmp_path / "scan", rig, frames, grid=grid, truth=np.ones(grid.shape))
    return tmp_path / "scan"


@pytest.fixture(scope="session")
def edit():
    """Return a function that changes the content of a scan.yaml by another function."""

    def run(folder, change):
        path = folder / "scan.yaml"
        content = yaml.safe_load(path.read_text())
        change(content)
        path.write_text(yaml.safe_dump(content))
        return path

    return run


@pytest.fixture(scope="session")
def assert_refused():
    """Return a function that asserts a one-line error that holds all parts."""

    def run(action, *parts, error=ValueError):
        with pytest.raises(error) as caught:
            action()
        message = str(caught.value)
        assert "\n" not in message
        for part in parts:
            assert part in message, message

    return run
