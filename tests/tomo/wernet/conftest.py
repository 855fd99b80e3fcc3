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


def flames(grid, turned=False):
    """Return a field that the voxels of ``grid`` resolve; another one where it is turned over."""
    center, size = np.asarray(grid.center), float(np.mean(grid.spacing))
    places = np.array([[1.3, -3.0, 0.4], [-1.2, 2.6, -0.8], [0.2, 0.5, 1.5]])
    places *= -1 if turned else 1
    return GaussianBlobs(center + size * places, size * np.array([1.6, 1.5, 1.8]), [1.0, 0.8, 0.6])


OPTICS = {
    "waves": lambda across, toward_x: 1 + 0.3 * np.sin(3 * across),
    "direction": lambda across, toward_x: 1 + 0.4 * toward_x**2,
}
"""Factors of light that no effect of `tomo.model` has: by the angle in the image, or in space."""


@lru_cache
def make_scene(
    views=12, effects=None, finer=1, grid=GRID, image_size=(14, 20), shading=0.0, turned=False
):
    """Return a ring's images, alternately from above and below, and their equations.

    With ``finer`` above 1, pixels and voxels of the images are: what the equations leave out.
    Images are ``shading`` brighter at their right edge, and as much darker at their left one.
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
    scan = simulate_images(rig, flames(grid, turned), grid, effects=effects, seed=3, **finite)
    system = LinearSystem.from_rig(rig, grid, midpoints=True)
    factor = 1 + shading * np.linspace(-1, 1, image_size[0], dtype=np.float32)
    images = [factor * image for image in scan.images.values()]
    return SimpleNamespace(
        grid=grid,
        rig=rig,
        scan=scan,
        truth=scan.truth,
        system=system,
        projector=system.projector,
        images=images,
        measured=system.flatten(images),
    )


@lru_cache
def make_optic(name="", turned=False):
    """Return images through one of `OPTICS`, or none, and equations in the linear basis.

    Pixels have an area, and the voxels of the images are finer than those of the equations.
    """
    from tomo.wernet import RayFeatures

    grid = VoxelGrid((14, 20, 14), 0.8, (4.0, -2.0, 1.0))
    one = make_scene(finer=2, grid=grid, image_size=(26, 38), turned=turned)
    measured = one.measured
    if name:
        of_ray = RayFeatures.of(one.projector, "optics").of_ray.numpy()
        measured = measured * OPTICS[name](of_ray[:, 3], of_ray[:, 0])
    noise = np.random.default_rng(3).normal(0, 0.003 * measured.max(), len(measured))
    return SimpleNamespace(
        grid=grid,
        truth=one.truth,
        projector=one.system.with_linear_basis().projector,
        measured=(measured + noise).astype(np.float32),
    )


def make_random_rays(counts, inputs="relative", unknowns=7, seed=0):
    """Return rays of random segments, so many each, in two views."""
    import torch

    from tomo.wernet import INPUTS, RayFeatures, Rays

    generator, count = torch.Generator().manual_seed(seed), torch.tensor(counts).long()
    total, numbers = int(count.sum()), INPUTS[inputs]
    return Rays(
        start=count.cumsum(0) - count,
        count=count,
        voxel=torch.randint(unknowns, (total,), generator=generator, dtype=torch.int32),
        length=0.1 + torch.rand(total, generator=generator),
        view=torch.arange(len(count)) % 2,
        features=RayFeatures(
            torch.zeros(len(count), 0), torch.randn(total, numbers, generator=generator)
        ),
        unknowns=unknowns,
        squared_radius=torch.rand(len(count), generator=generator),
    )


@pytest.fixture(scope="session")
def random_rays():
    """Return the function that makes rays of random segments."""
    return make_random_rays


@pytest.fixture(scope="session")
def scene():
    """Return the function that makes scenes, each once."""
    return make_scene


@pytest.fixture(scope="session")
def optic():
    """Return the function that makes images by unknown optics, each once."""
    return make_optic
