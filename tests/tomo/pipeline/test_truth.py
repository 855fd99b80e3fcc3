"""The volume against the truth of a simulated scan."""

import numpy as np
import pytest

from phantoms import GaussianBlobs
from rigs import ring
from tomo import Scan, VoxelGrid, load_scan
from tomo.io import write_volume
from tomo.pipeline import Options, reconstruct
from tomo.simulation import simulate_images

pytestmark = pytest.mark.usefixtures("quick_choices")

SIRT = {"method": "sirt", "iterations": 5}


def test_the_volume_is_close_to_the_truth(outcome):
    assert outcome.solution.quality["cosine_distance"] < 0.025
    assert outcome.solution.quality["total_ratio"] == pytest.approx(1, abs=0.05)
    assert outcome.solution.relative_residual < 0.17
    for view in outcome.views:
        assert view.gain == pytest.approx(1, abs=0.02)


def test_the_distances_from_the_truth_end_at_the_volume_s_own(outcome):
    distances = [entry.distance for entry in outcome.solution.history]
    assert None not in distances
    own = outcome.solution.quality["cosine_distance"]
    assert distances[-1] == pytest.approx(own, rel=1e-3)
    assert distances[0] > 2 * own  # it starts from a few updates of MLEM


def test_a_truth_that_is_a_voxel_s_part_off_is_not_compared(copy, grid, as_given):
    for shift, alike in ((1e-9, True), (1e-3, False)):
        moved = VoxelGrid(grid.shape, grid.spacing, (1e5 + shift, 0.0, 0.0))
        write_volume(copy / "truth.npz", np.ones(grid.shape), moved)
        scan = load_scan(copy)
        # the same scene far away, where coordinates are large
        distant = VoxelGrid(grid.shape, grid.spacing, (1e5, 0.0, 0.0))
        rig = scan.rig.transformed(np.eye(3), np.array([1e5, 0, 0]) - grid.center)
        scan = Scan(rig, scan.frames, truth=scan.truth, source=copy)
        assert (reconstruct(scan, distant, Options(**SIRT, **as_given)).truth is not None) == alike


def test_shrunk_images_say_the_same(folder, outcome):
    found = reconstruct(load_scan(folder).scaled(2), options=Options(uncertainty=0))
    assert found.counts["rays"] < 0.4 * outcome.counts["rays"]
    assert found.scan["scale"] == 2
    assert found.solution.quality["cosine_distance"] < 0.025
    assert found.solution.quality["total_ratio"] == pytest.approx(1, abs=0.05)


@pytest.mark.parametrize("rows", [1, 2])
def test_cameras_of_a_row_or_two_show_a_slice(tmp_path, rows):
    flat = VoxelGrid((20, rows, 20), 1.0)
    rig = ring(12, distance=200.0, image_size=(64, rows), footprint=0.5)
    field = GaussianBlobs([[1, 0, 2], [-3, 0, -2]], [2.0, 2.5], [1.0, 0.7])
    simulate_images(rig, field, flat, supersample=2).save(tmp_path / "scan")
    found = reconstruct(load_scan(tmp_path / "scan"))
    assert found.solution.quality["cosine_distance"] < 0.002
    assert found.warnings == ()
