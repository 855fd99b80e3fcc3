"""A turbulent flame through lenses out of focus, and the same in focus."""

from types import SimpleNamespace

import pytest

import phantoms
import rigs
from tomo import LinearSystem, VoxelGrid
from tomo.simulation import simulate_images
from tomo.simulation.effects import Effects

GRID = VoxelGrid((20, 60, 20), 0.5)
DISTANCE, FOCUS, APERTURE = 5800.0, 5600.0, 29.0
BLUR = APERTURE * (DISTANCE - FOCUS) / FOCUS


@pytest.fixture(scope="session")
def cameras():
    """Return the cameras and what they see the grid by, without images."""
    rig = rigs.ring(12, distance=DISTANCE, image_size=(64, 144), footprint=0.25)
    system = LinearSystem.from_rig(rig, GRID, midpoints=True)
    return SimpleNamespace(grid=GRID, rig=rig, system=system, blur=BLUR)


def taken(cameras, effects):
    field = phantoms.create("turbulent", 5, GRID.extent, GRID.center)
    scan = simulate_images(cameras.rig, field, GRID, supersample=2, refine=2, effects=effects)
    images = list(scan.images.values())
    return SimpleNamespace(**vars(cameras), scan=scan, images=images, truth=scan.truth)


@pytest.fixture(scope="session")
def out_of_focus(cameras):
    """Return images whose points are discs of a millimetre, four pixels or two voxels."""
    lens = Effects(aperture=APERTURE, focus_distance=FOCUS, aperture_rays=128)
    return taken(cameras, lens)  # fewer rays are no disc at the frequencies of its first zero


@pytest.fixture(scope="session")
def in_focus(cameras):
    """Return the images of pinholes."""
    return taken(cameras, None)
