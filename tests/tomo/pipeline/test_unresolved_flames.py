"""Exact cameras before a flame that voxels do not resolve: nothing is wrong with any of them."""

import phantoms
import rigs
import tomo


def test_no_camera_is_left_out_for_what_the_voxels_lack():
    """The opposite camera is held out: the accused one alone sees the flame from its side."""
    grid = tomo.VoxelGrid((12, 20, 12), 1.0)
    rig = rigs.ring(8, distance=400, image_size=(28, 40), footprint=0.6, pitch_degrees=10)
    jet = phantoms.create("jet", extent=grid.extent)
    scan = tomo.simulate(rig, jet, grid, supersample=2, refine=2, noise=0.0015, seed=0)
    found = tomo.reconstruct(scan, options=tomo.Options(hold_out=["cam03"], uncertainty=0))
    assert not found.findings
    assert found.report()["quality"]["nrmse"] < 0.18
