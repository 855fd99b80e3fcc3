"""What every method returns: zero where no ray says anything, in figures and repeats too."""

import numpy as np
import pytest

from phantoms import create
from rigs import ring
from tomo import LinearSystem, VoxelGrid
from tomo.metrics import cosine_distance
from tomo.pipeline import Options
from tomo.pipeline.build import Basis, WeightedSystem
from tomo.pipeline.solve import repeatable, solve
from tomo.pipeline.view import quality
from tomo.simulation import simulate_images

GRID = VoxelGrid((10, 24, 10), 1.0)


@pytest.fixture(scope="module")
def case():
    rig = ring(6, distance=200.0, image_size=(30, 16), footprint=0.5)  # sees a third of the height
    made = simulate_images(rig, create("turbulent", 1, GRID.extent), GRID, supersample=2)
    system = LinearSystem.from_rig(rig, GRID)
    return system, system.flatten(list(made.images.values())), made.truth


@pytest.mark.parametrize("method", ["auto", "tikhonov", "sirt"])
def test_voxels_that_no_ray_crosses_are_zero(case, method):
    system, measured, truth = case
    assert system.unseen.any()
    built = WeightedSystem(system, measured, None, {}, Basis("voxel", ""))
    options = Options(method=method, iterations=5)
    solved = solve(built, options, watch=lambda volume: cosine_distance(volume, truth))
    found = solved.solution
    assert found.volume.any()
    assert not found.volume[system.unseen].any()
    own = quality(found.volume, truth)["cosine_distance"]
    assert found.history[-1].distance == pytest.approx(own)
    again = system.projector.active.expand(repeatable(solved, options)(measured))
    np.testing.assert_array_equal(again, found.volume.ravel())
