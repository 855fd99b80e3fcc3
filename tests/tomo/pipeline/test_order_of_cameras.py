"""The order in which a rig lists its cameras is no property of a scene."""

from dataclasses import replace

import numpy as np

import phantoms
import rigs
from tomo import Scan, VoxelGrid
from tomo.pipeline import Options, reconstruct
from tomo.simulation import simulate_images

GRID = VoxelGrid((12, 16, 12), 1.2)
RIG = rigs.ring(
    6, distance=300.0, image_size=(24, 32), footprint=0.8, pitch_degrees=[-8.0, 8.0, 3.0] * 2
)
MIXED = [4, 2, 0, 1, 3, 5]


def volume(seen, order):
    """Return the volume from cameras in some order, one of them beside its place."""
    cameras = list(RIG)
    cameras[3] = cameras[3].shifted(1.5, -0.8)
    rig = replace(RIG, cameras=tuple(cameras[number] for number in order))
    scan = Scan.from_arrays(rig, {camera.name: seen.images[camera.name] for camera in rig}, GRID)
    return reconstruct(scan, options=Options(uncertainty=0)).volume


def test_the_order_of_cameras_changes_no_volume(quick_solve):
    field = phantoms.create("turbulent", 3, GRID.extent, GRID.center)
    seen = simulate_images(RIG, field, GRID, supersample=2, refine=2, noise=0.005)
    expected, found = (volume(seen, order) for order in (range(6), MIXED))
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-5 * expected.max())
