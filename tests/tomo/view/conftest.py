import numpy as np
import pytest

import rigs
from tomo.grid import VoxelGrid
from tomo.operators import LinearSystem
from tomo.scan import Scan
from tomo.view import Content
from tomo.view.content import Frames

GRID = VoxelGrid((12, 16, 10), (1.0, 1.0, 1.5), (2.0, -1.0, 3.0))


@pytest.fixture(scope="session")
def grid():
    return GRID


@pytest.fixture(scope="session")
def flames():
    """Return three volumes: a spot that rises."""
    x, y, z = np.moveaxis(GRID.centers() - GRID.center, -1, 0)
    return [
        np.exp(-((x / 3) ** 2) - ((y - 2 * t + 2) / 4) ** 2 - (z / 4) ** 2).astype(np.float32)
        for t in range(3)
    ]


@pytest.fixture(scope="session")
def scan(flames):
    """Return what four cameras see of the three volumes, in voxels of constant emission."""
    rig = rigs.ring(4, distance=60.0, image_size=(24, 28), footprint=0.9, center=GRID.center)
    system = LinearSystem.from_rig(rig, GRID)
    frames = [
        system.images(system.projector @ system.projector.active.compress(one)) for one in flames
    ]
    images = {
        name: np.stack([frame[number] for frame in frames])
        for number, name in enumerate(rig.names)
    }
    return Scan.from_arrays(rig, images, GRID)


@pytest.fixture(scope="session")
def content(flames, scan):
    frames = Frames(("start", "middle", "end"), flames.__getitem__)
    return Content("spot", scan.rig, GRID, frames, scan, scan.frame_names)
