"""Small scenes: a ring of cameras around three smooth flames."""

import os
from functools import lru_cache
from types import SimpleNamespace

os.environ.setdefault("OMP_WAIT_POLICY", "passive")  # as tomo does, if loaded before torch is

import numpy as np
import pytest

import rigs
from phantoms import GaussianBlobs
from tomo import LinearSystem, VoxelGrid
from tomo.simulation import simulate_images

GRID = VoxelGrid((10, 16, 10), 1.0, (4.0, -2.0, 1.0))


@pytest.fixture(autouse=True)
def _one_thread(on_threads):
    # Tiny arrays are slower on several threads; tests of their number set it themselves.
    with on_threads(1):
        yield


def flames(grid):
    """Return a field that the voxels of ``grid`` resolve."""
    center, size = np.asarray(grid.center), float(np.mean(grid.spacing))
    places = np.array([[1.3, -3.0, 0.4], [-1.2, 2.6, -0.8], [0.2, 0.5, 1.5]])
    return GaussianBlobs(center + size * places, size * np.array([1.6, 1.5, 1.8]), [1.0, 0.8, 0.6])


@lru_cache
def make_scene(views=12, effects=None, finer=1, seed=3, grid=GRID, image_size=(14, 20)):
    """Return a ring's images, alternately from above and below, and their equations.

    With ``finer`` above 1, pixels and voxels of the images are: what the equations leave out.
    """
    edge = float(np.mean(grid.spacing))
    rig = rigs.ring(
        views,
        distance=100.0 * edge,
        image_size=image_size,
        footprint=16.8 * edge / image_size[1],
        center=grid.center,
        pitch_degrees=[12.0 * (-1) ** view for view in range(views)],
    )
    finite = {"supersample": finer, "refine": finer}
    scan = simulate_images(rig, flames(grid), grid, effects=effects, seed=seed, **finite)
    system = LinearSystem.from_rig(rig, grid, midpoints=True)
    return SimpleNamespace(
        grid=grid,
        rig=rig,
        scan=scan,
        truth=scan.truth,
        system=system,
        projector=system.projector,
        measured=system.flatten(list(scan.images.values())),
    )


@pytest.fixture(scope="session")
def scene():
    """Return the function that makes scenes, each once."""
    return make_scene
