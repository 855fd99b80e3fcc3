"""Views held out, pixels masked, rays and voxels left out: their effect on the volume."""

import numpy as np
import pytest
import tifffile
import yaml

from tomo import VoxelGrid, load_scan
from tomo.pipeline import Options, reconstruct

pytestmark = pytest.mark.usefixtures("quick_solves")

SIRT = {"method": "sirt", "iterations": 5}
HELD_OUT = Options(hold_out=["cam02"], uncertainty=0)


def test_a_held_out_view_is_predicted(folder, as_given):
    found = reconstruct(load_scan(folder), hold_out=["cam02"], **as_given)
    figures = found.report()["held_out"]["cam02"]
    assert figures["psnr"] > 30
    assert figures["ssim"] > 0.94
    assert figures["cosine"] > 0.985


def test_a_held_out_view_is_only_evaluated(quick_choice, copy, garble):
    """Whatever it shows, the volume is that of a scan without the camera."""
    garble(copy / "images/cam02/frame_000.tif")
    scan = load_scan(copy)
    found = reconstruct(scan, options=HELD_OUT)
    without = reconstruct(scan.without("cam02"), options=Options(uncertainty=0))
    np.testing.assert_array_equal(found.volume, without.volume)
    assert found.solution.settings == without.solution.settings
    assert found.report()["held_out"]["cam02"]["psnr"] < 20
    assert [view.name for view in found.views] == [f"cam0{n}" for n in range(6)]
    assert [view.held_out for view in found.views] == [n == 2 for n in range(6)]


def test_masked_pixels_never_matter(quick_choice, copy, as_given, far, garble):
    mask = np.ones((60, 40), np.uint8)
    mask[10:25, 5:30] = 0
    shown = tifffile.imread(copy / "images/cam01/frame_000.tif")
    tifffile.imwrite(copy / "mask.tif", mask)
    content = yaml.safe_load((copy / "scan.yaml").read_text())
    content["corrections"] = {"mask": {"cam01": "mask.tif", "cam02": "mask.tif"}}
    (copy / "scan.yaml").write_text(yaml.safe_dump(content))
    before = reconstruct(load_scan(copy), options=HELD_OUT)
    for camera in ("cam01", "cam02"):
        path = copy / f"images/{camera}/frame_000.tif"
        garble(path, mask == 0)
        pixels = tifffile.imread(path)
        pixels[12, 10:15] = [np.nan, np.inf, -np.inf, 1e30, -1e30]
        tifffile.imwrite(path, pixels)
    after = reconstruct(load_scan(copy), options=HELD_OUT)
    np.testing.assert_array_equal(after.solution.volume, before.solution.volume)
    assert after.report()["held_out"] == before.report()["held_out"]
    assert after.report()["views"] == before.report()["views"]
    assert before.solution.quality["cosine_distance"] < 0.03
    tifffile.imwrite(copy / "images/cam01/frame_000.tif", shown)
    garble(copy / "images/cam01/frame_000.tif")  # unmasked and not looked for, it does matter
    found = reconstruct(load_scan(copy), hold_out=["cam02"], **as_given)
    assert far(found.solution.volume, before.solution.volume) > 0.05


@pytest.mark.parametrize("method", ["auto", "cgls", "sirt", "mlem", "sart"])
def test_pixels_that_miss_the_grid_change_nothing(quick_choice, folder, method, far, as_given):
    settings = {"method": method, "iterations": 10}
    if method == "auto":  # its stop depends on which pixels it leaves out
        settings |= {"iterations": None, "basis": "voxel"}
    skipped, whole = (
        reconstruct(load_scan(folder), options=Options(**one, **settings, **as_given))
        for one in ({"carving": "off"}, {"skip": False})
    )
    assert whole.counts["rays"] == 6 * 40 * 60 > skipped.counts["rays"]
    assert whole.counts["segments"] == skipped.counts["segments"]
    assert far(whole.solution.volume, skipped.solution.volume) < 1e-5
    for one, other in zip(whole.views, skipped.views, strict=True):
        np.testing.assert_allclose(one.reprojected, other.reprojected, atol=1e-4)


def test_voxels_proved_empty_take_no_part_and_cost_nothing(folder, grid, as_given):
    settings = as_given | {"method": "cgls", "iterations": 15}
    carved = reconstruct(load_scan(folder), options=Options(**settings))
    whole = reconstruct(load_scan(folder), options=Options(carving="off", **settings))
    assert carved.counts["active_voxels"] < whole.counts["active_voxels"] == grid.size
    assert carved.counts["segments"] < whole.counts["segments"]
    report = carved.report()["carving"]
    assert report["active_voxels"] == carved.counts["active_voxels"]
    assert report["pixels_used"] < report["pixels_recorded"] == 6 * 40 * 60
    assert "are dark in" in report["reason"]
    # what was left out is empty, and what is left is found no worse
    emptied = carved.solution.volume == 0
    assert np.sum(carved.truth[emptied] ** 2) < 2e-3 * np.sum(carved.truth**2)
    assert (
        carved.solution.quality["cosine_distance"]
        < 1.02 * whole.solution.quality["cosine_distance"]
    )


def test_unseen_voxels_are_counted_and_reported(folder, grid, as_given):
    wide = VoxelGrid((60, 20, 10), 1.0, grid.center)
    found = reconstruct(load_scan(folder), wide, Options(carving="off", **SIRT, **as_given))
    assert 0 < found.counts["active_voxels"] < wide.size
    share = 1 - found.counts["active_voxels"] / wide.size
    assert any(w.startswith(f"{share:.1%} of the voxels are seen by no") for w in found.warnings)


def test_unseen_voxels_are_zero_and_marked(folder, grid, as_given):
    wide = VoxelGrid((60, 20, 10), 1.0, grid.center)
    found = reconstruct(load_scan(folder), wide, Options(**SIRT, **as_given))
    active = found.carving["active_voxels"]
    assert found.unseen.sum() == active - found.counts["active_voxels"] > 0
    assert not found.volume[found.unseen].any()
