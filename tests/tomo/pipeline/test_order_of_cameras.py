"""The order in which a rig lists its cameras is no property of a scene."""

from dataclasses import replace

import numpy as np
import pytest

import phantoms
import rigs
from tomo import Scan, VoxelGrid
from tomo.pipeline import Options, reconstruct
from tomo.simulation import simulate_images

GRID = VoxelGrid((12, 16, 12), 1.2)
RIG = rigs.ring(
    9, distance=300.0, image_size=(32, 42), footprint=0.6, pitch_degrees=[-8.0, 8.0, 3.0] * 3
)
MIXED = [4, 2, 7, 0, 8, 1, 3, 6, 5]


@pytest.fixture(scope="module")
def seen():
    field = phantoms.create("turbulent", 3, GRID.extent, GRID.center)
    return simulate_images(RIG, field, GRID, supersample=2, refine=2, noise=0.005)


def volume(seen, order, shift):
    """Return the volume from cameras in some order, one of them beside its place."""
    cameras = list(RIG)
    cameras[3] = cameras[3].shifted(*shift)
    rig = replace(RIG, cameras=tuple(cameras[number] for number in order))
    scan = Scan.from_arrays(rig, {camera.name: seen.images[camera.name] for camera in rig}, GRID)
    return reconstruct(scan, options=Options(uncertainty=0)).volume


@pytest.mark.parametrize("shift", [(0.0, 0.0), (2.0, -1.0)])
def test_the_order_of_cameras_changes_no_volume(seen, shift):
    expected, found = (volume(seen, order, shift) for order in (range(9), MIXED))
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-5 * expected.max())
