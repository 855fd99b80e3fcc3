"""What every method returns: zero where no ray says anything, in figures and repeats too."""

import numpy as np
import pytest

from phantoms import create
from rigs import ring
from tomo import LinearSystem, VoxelGrid
from tomo.pipeline.methods import method_named
from tomo.pipeline.reconstruction import quality
from tomo.pipeline.run import Run
from tomo.simulation import simulate

GRID = VoxelGrid((10, 24, 10), 1.0)


@pytest.fixture(scope="module")
def case():
    rig = ring(6, distance=200.0, image_size=(30, 16), footprint=0.5)  # sees a third of the height
    made = simulate(rig, create("turbulent", 1, GRID.extent), GRID, supersample=2)
    system = LinearSystem.from_rig(rig, GRID)
    return system, system.flatten(list(made.images.values())), made.truth


@pytest.mark.parametrize("method", ["auto", "tikhonov", "sirt"])
def test_voxels_that_no_ray_crosses_are_zero(case, method):
    system, measured, truth = case
    assert system.unseen.any()
    run = Run(system.projector, measured, truth, {}, 0, None, None)
    found = run.solve(method_named(method), 5)
    assert found.volume.any()
    assert not found.volume[system.unseen].any()
    assert found.quality == quality(found.volume, truth)
    assert run.cosine_distances[0][-1] == pytest.approx(found.quality["cosine_distance"])
    again = system.projector.active.expand(run.again(method_named(method), found)(measured))
    np.testing.assert_array_equal(again, found.volume.ravel())
