"""A turbulent flame through lenses out of focus, and the same in focus."""

from types import SimpleNamespace

import numpy as np
import pytest
import scipy.sparse

import phantoms
import rigs
from tomo import LinearSystem, VoxelGrid
from tomo.simulation import simulate_images
from tomo.simulation.effects import Effects

DISTANCE, FOCUS, APERTURE = 5800.0, 5600.0, 29.0
BLUR = APERTURE * (DISTANCE - FOCUS) / FOCUS


def seen_by(grid, image_size):
    """Return cameras and what they see the grid by, without images."""
    rig = rigs.ring(12, distance=DISTANCE, image_size=image_size, footprint=0.25)
    system = LinearSystem.from_rig(rig, grid, midpoints=True)
    return SimpleNamespace(grid=grid, rig=rig, system=system, blur=BLUR)


@pytest.fixture(scope="session")
def cameras():
    return seen_by(VoxelGrid((20, 60, 20), 0.5), (64, 144))


@pytest.fixture(scope="session")
def fewer_pixels():
    """Return cameras of the images that are reconstructed."""
    return seen_by(VoxelGrid((16, 40, 16), 0.5), (52, 100))


def taken(cameras, effects):
    grid = cameras.grid
    field = phantoms.create("turbulent", 5, grid.extent, grid.center)
    scan = simulate_images(cameras.rig, field, grid, supersample=2, refine=2, effects=effects)
    images = list(scan.images.values())
    return SimpleNamespace(**vars(cameras), scan=scan, images=images, truth=scan.truth)


@pytest.fixture(scope="session")
def out_of_focus(fewer_pixels):
    """Return images whose points are discs of a millimetre, four pixels or two voxels."""
    lens = Effects(aperture=APERTURE, focus_distance=FOCUS, aperture_rays=128)
    return taken(fewer_pixels, lens)  # fewer rays are no disc at the frequencies of its first zero


@pytest.fixture(scope="session")
def in_focus(fewer_pixels):
    """Return the images of pinholes."""
    return taken(fewer_pixels, None)


@pytest.fixture(scope="session")
def matrix_of():
    return slow_matrix


def slow_matrix(blur):
    """Return the matrix of an image blur, entry by entry."""
    place = {
        where: number
        for number, where in enumerate(
            zip(blur.rays.view, blur.rays.row, blur.rays.column, strict=True)
        )
        if blur.rays.seen[number]
    }
    entries = []
    parts = blur.pixels.view, blur.pixels.row, blur.pixels.column
    for pixel, (view, row, column) in enumerate(zip(*parts, strict=True)):
        if not blur.pixels.seen[pixel]:
            continue
        offsets, weights = blur.kernels[view]
        for (right, down), weight in zip(offsets, weights, strict=True):
            ray = place.get((view, row + down, column + right))
            if ray is not None:
                entries.append((pixel, ray, weight))
        if blur.own[pixel]:
            entries.append((pixel, place[view, row, column], blur.own[pixel]))
    rows, columns, values = zip(*entries, strict=True) if entries else ((), (), ())
    data = np.asarray(values, np.float32)
    return scipy.sparse.csr_array((data, (rows, columns)), blur.shape)
