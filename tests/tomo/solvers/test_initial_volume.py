import numpy as np
import pytest

from tomo import solvers
from tomo.metrics import cosine_distance
from tomo.solvers.initial_volume import mlos_start
from tomo.solvers.iterate import interleaved


def test_it_is_far_nearer_to_the_volume_than_an_even_start(ring_system):
    found = mlos_start(ring_system.projector, ring_system.measured)
    even = np.ones_like(found)
    truth = ring_system.truth.ravel()
    assert cosine_distance(found, truth) < 0.3 * cosine_distance(even, truth)
    total = (ring_system.projector @ found).sum()
    assert total == pytest.approx(ring_system.measured.sum(), rel=1e-4)


def test_fewer_iterations_are_needed_from_there(ring_system):
    projector, measured = ring_system.projector, ring_system.measured
    start = mlos_start(projector, measured)
    residuals = [
        solvers.mlem(projector, measured, iterations=4, start=at).relative_residual
        for at in (None, start)
    ]
    assert residuals[1] < 0.7 * residuals[0]


def test_it_is_dim_wherever_one_view_is_dark(ring_system):
    projector, measured = ring_system.projector, ring_system.measured.copy()
    measured[projector.pixels_of([3])[:160]] = 0  # the upper half of one image
    seen = projector.view(3).rows(0, 160).column_sums > 0
    dark = seen & (projector.view(3).rows(160, 320).column_sums == 0)
    found = mlos_start(projector, measured)
    assert dark.sum() > 100
    assert 0 < found[dark].max() < 1e-3 * found.max()


def test_a_voxel_out_of_some_view_starts_from_the_views_that_see_it(projector_of):
    matrix = np.array([[1.0, 1, 0, 0], [0, 0, 1, 0], [1, 0, 0, 0], [0, 1, 0, 1]])
    projector = projector_of(matrix, [0, 2, 4])  # the last two voxels are each seen by one view
    found = mlos_start(projector, np.array([2.0, 0, 1, 1]))
    assert found[2] < 1e-3 * found.max()  # its only view shows no light
    assert found[3] > 0.1 * found.max()


def test_a_camera_that_sees_a_part_of_the_grid_leaves_the_rest_lit(ring_system):
    projector, measured = ring_system.projector, ring_system.measured
    # one camera shows the lower half alone
    kept = np.setdiff1d(np.arange(projector.shape[0]), projector.pixels_of([3])[:160])
    cut = projector.take(kept)
    assert (cut.view(3).column_sums == 0).any()
    start = mlos_start(cut, measured[kept])
    found = solvers.mlem(cut, measured[kept], iterations=20, start=start)
    whole = solvers.mlem(projector, measured, iterations=20, start=mlos_start(projector, measured))
    assert found.relative_residual < 1.5 * whole.relative_residual


def test_dark_images_start_dark_and_negative_pixels_count_as_zero(ring_system):
    projector, measured = ring_system.projector, ring_system.measured
    assert not mlos_start(projector, np.zeros_like(measured)).any()
    below = measured.copy()
    below[interleaved(len(below), 5)[0]] = -3
    clipped = np.maximum(below, 0)
    np.testing.assert_array_equal(mlos_start(projector, below), mlos_start(projector, clipped))
