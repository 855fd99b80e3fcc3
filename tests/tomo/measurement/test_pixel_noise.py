import numpy as np
import pytest

import rigs
from phantoms import GaussianBlobs
from tomo import LinearSystem, VoxelGrid
from tomo.measurement.noise_model import ORDER, noise_from_differences
from tomo.simulation import simulate

GRID = VoxelGrid((10, 16, 10), 1.0)


@pytest.fixture(scope="module")
def pixels():
    """Return the pixels of a ring's images of three smooth flames, finer than the voxels."""
    rig = rigs.ring(
        12, distance=100.0, image_size=(42, 60), footprint=0.28,
        pitch_degrees=[12.0 * (-1) ** view for view in range(12)],
    )  # fmt: skip
    places = [[1.3, -3.0, 0.4], [-1.2, 2.6, -0.8], [0.2, 0.5, 1.5]]
    field = GaussianBlobs(places, [1.6, 1.5, 1.8], [1.0, 0.8, 0.6])
    scan = simulate(rig, field, GRID, supersample=2, refine=2)
    return LinearSystem.from_rig(rig, GRID).flatten(scan.images())


@pytest.mark.parametrize("fraction", [0.01, 0.02, 0.1])
def test_noise_is_distinguished_from_flames(pixels, fraction):
    brightest = pixels.max()
    assert noise_from_differences(pixels) < 2e-4 * brightest
    random = np.random.default_rng(5).standard_normal(len(pixels))
    found = noise_from_differences((pixels + fraction * brightest * random).astype(np.float32))
    # some views look along voxels, whose edges show
    assert 0.98 < found / (fraction * brightest) < 1.2


def test_a_few_pixels_and_dark_ones_have_no_noise():
    random = np.random.default_rng(0).standard_normal(ORDER + 1).astype(np.float32)
    assert noise_from_differences(random[:0]) == noise_from_differences(random[:ORDER]) == 0
    assert noise_from_differences(random) > 0
    assert noise_from_differences(np.zeros(50, np.float32)) == 0
