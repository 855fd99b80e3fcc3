import re

import numpy as np
import pytest

from tomo import Volume, VoxelGrid, metrics
from tomo.report.volume_comparison import VolumeComparison

GRID = VoxelGrid((14, 20, 12), (1.0, 0.8, 1.2), (1.0, 2.0, 3.0))
UNIT = "W/m^3/sr"


def flame(grid, factor=1.0, unit=UNIT, length="mm"):
    squares = ((grid.centers() - GRID.center) ** 2 / [9, 25, 9]).sum(axis=-1)
    return Volume((factor * np.exp(-squares)).astype(np.float32), grid, length, unit)


def test_equal_volumes_differ_by_nothing():
    found = VolumeComparison.of(flame(GRID), flame(GRID)).figures
    assert found["nrmse"] == found["cosine_distance"] == found["largest_difference"] == 0
    assert found["total_ratio"] == found["peak_ratio"] == found["ssim"] == 1
    assert found["psnr"] is None  # infinite
    assert found["notes"] == []
    assert found["total_unit"] == "W/sr"


def test_figures_are_those_of_second_against_first():
    first, second = flame(GRID), flame(GRID, 1.25)
    second[3, 4, 5] += 0.1
    found = VolumeComparison.of(first, second).figures
    assert found["nrmse"] == metrics.nrmse(second, first)
    assert found["psnr"] == metrics.psnr(second, first)
    assert found["peak_ratio"] == pytest.approx(1.25, rel=1e-6)
    assert found["a"]["total"] == pytest.approx(first.total() * 1e-9)


def test_another_grid_is_resampled_and_said():
    coarse = VoxelGrid((7, 10, 6), (2.0, 1.6, 2.4), GRID.center)
    found = VolumeComparison.of(flame(coarse), flame(GRID), ("coarse", "fine"))
    assert found.second.grid == coarse
    assert found.figures["total_ratio"] == pytest.approx(1, rel=0.01)
    assert found.figures["nrmse"] < 0.1
    (note,) = found.notes
    assert note.startswith("fine, 14 × 20 × 12 voxels of 1 × 0.8 × 1.2 mm around (1, 2, 3)")
    part = VoxelGrid((14, 10, 12), GRID.spacing, GRID.center)
    notes = VolumeComparison.of(flame(GRID), flame(part)).notes
    assert "50.0% of the box of A is outside that of B" in notes[1]


def test_volumes_that_are_not_comparable_are_refused():
    away = VoxelGrid(GRID.shape, GRID.spacing, (99, 0, 0))
    with pytest.raises(ValueError, match=r"B: found .* expected a part of the box of A"):
        VolumeComparison.of(flame(GRID), flame(away))
    with pytest.raises(ValueError, match="B: length_unit: found 'm', expected 'mm'"):
        VolumeComparison.of(flame(GRID), flame(GRID, length="m"))


def test_other_units_unseen_voxels_and_darkness_are_said():
    holed = flame(GRID, unit="")
    holed[0, 0, :3] = np.nan
    found = VolumeComparison.of(flame(GRID), holed)
    assert found.notes[0].startswith("units differ: W/m^3/sr and no unit")
    assert found.notes[1] == "3 voxels are NaN in one of them, and left out"
    assert found.figures["nrmse"] == 0
    dark = VolumeComparison.of(flame(GRID, 0.0), flame(GRID))
    assert dark.figures["nrmse"] is dark.figures["total_ratio"] is dark.figures["psnr"] is None
    thin = VoxelGrid((5, 4, 1), 1.0, GRID.center)
    assert VolumeComparison.of(flame(thin), flame(thin)).figures["ssim"] is None


def test_the_page_needs_nothing_else_and_escapes_names(tmp_path):
    names = ("<script>alert(1)</script>", "$\\frac{")
    VolumeComparison.of(flame(GRID), flame(GRID, 1.1), names).write(tmp_path / "a.html")
    page = (tmp_path / "a.html").read_text("utf-8")
    assert "<script>" not in page
    assert page.count("data:image/png;base64,") == 1
    assert not re.findall(r"https?://", page)
    assert "NRMSE" in page
    dark = VolumeComparison.of(flame(GRID, 0.0), flame(GRID, 0.0))
    dark.write(tmp_path / "dark.html")  # nothing to draw is no error
