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


def taken(effects):
    field = phantoms.create("turbulent", 5, GRID.extent, GRID.center)
    rig = rigs.ring(12, distance=DISTANCE, image_size=(64, 144), footprint=0.25)
    scan = simulate_images(rig, field, GRID, supersample=2, refine=2, effects=effects)
    return SimpleNamespace(
        grid=GRID,
        rig=rig,
        scan=scan,
        images=list(scan.images.values()),
        truth=scan.truth,
        system=LinearSystem.from_rig(rig, GRID, midpoints=True),
        blur=BLUR,
    )


@pytest.fixture(scope="session")
def out_of_focus():
    """Return images whose points are discs of a millimetre, four pixels or two voxels."""
    lens = Effects(aperture=APERTURE, focus_distance=FOCUS, aperture_rays=128)
    return taken(lens)  # fewer rays are no disc at the frequencies of its first zero


@pytest.fixture(scope="session")
def in_focus():
    """Return the images of pinholes."""
    return taken(None)
