"""What an outcome tells: figures, views, comparisons, warnings."""

import json

import numpy as np
import pytest
import tifffile

from rigs.progress import stage_of
from tomo import load_scan
from tomo.pipeline import Options, reconstruct
from tomo.pipeline.evaluate import data_range
from tomo.report.outcome_files import results_of

pytestmark = pytest.mark.usefixtures("quick_choices")

REPORT = {
    "method", "seconds", "first_use_seconds", "peak_memory_mb", "rays", "segments", "voxels",
    "active_voxels", "relative_residual", "stop_reason", "quality", "held_out", "views",
    "versions", "seed", "settings",
}  # fmt: skip


def test_the_report_holds_the_promised_keys(outcome, grid):
    report = json.loads(json.dumps(outcome.report(), allow_nan=False))
    assert set(report) >= REPORT
    assert set(report["seconds"]) >= {"load", "trace", "solve", "total"}
    assert 0 < report["seconds"]["solve"] < report["seconds"]["total"]
    assert set(report["quality"]) >= {"cosine_distance", "nrmse"}
    assert report["method"] == "curvature"
    assert report["solver"]["chosen_by"] == "auto"
    assert report["voxels"] == grid.size > report["active_voxels"]
    assert report["rays"] > 0
    assert report["segments"] > report["rays"]
    assert report["peak_memory_mb"] > 50
    assert report["held_out"] == {}
    (warning,) = report["warnings"]
    assert "as large as the emission itself" in warning  # each camera is opposite another
    assert list(report["views"]) == [f"cam0{n}" for n in range(6)]
    assert report["versions"]["numpy"] == np.__version__
    assert report["seed"] == 0


@pytest.mark.parametrize("method", ["auto", "sirt"])
def test_progress_is_reported_all_the_way(folder, method):
    calls = []
    reconstruct(
        load_scan(folder),
        options=Options(method=method),
        progress=lambda *call: calls.append(call),
    )
    assert all(0 <= done <= total for done, total, _ in calls)
    where = [stage_of(place) for _, _, place in calls]
    stages = list(dict.fromkeys(stage for stage, _ in where))
    assert stages[0] == "compiling"
    assert stages[-1] == "how far to trust it"
    assert [step for stage, step in where if stage == "tracing" and step] == [
        f"cam0{n}" for n in range(6)
    ]
    solving = [step for stage, step in where if stage == "smoothness and solve"]
    assert any(step.startswith("choosing: setting 2") for step in solving) == (method == "auto")
    if method == "auto":
        done, total, name = calls[-1]
        assert done == total
        assert stage_of(name)[1] == "errors of a known answer"


SIRT = {"method": "sirt", "iterations": 5}


def test_a_comparison_that_is_no_sequence_is_refused(folder):
    with pytest.raises(ValueError, match="compare: found 'sirt', expected METHOD or METHOD:ITER"):
        reconstruct(load_scan(folder), options=Options(compare="sirt"))


def test_comparisons_change_nothing(folder, volume_of):
    compare = ["wernet-paper:1", "mlem:3", "sart:2"]
    scan = load_scan(folder).scaled(2)
    found = reconstruct(scan, options=Options(compare=compare, uncertainty=0))
    np.testing.assert_array_equal(found.solution.volume, volume_of(scan))
    beside = found.report()["comparisons"]
    assert [one["method"] for one in beside] == ["wernet-paper", "mlem", "sart"]
    assert all(np.isfinite(one["quality"]["cosine_distance"]) for one in beside)
    # the curves of two runs of one method are not mixed up
    for course, run in zip(
        results_of(found).history, (found.solution, *found.comparisons), strict=True
    ):
        assert len(course.cosine_distance) == len(run.history)
        own = run.quality["cosine_distance"]
        assert course.cosine_distance[-1] == pytest.approx(own, rel=1e-3)
    assert found.seconds["compare"] > 0


@pytest.mark.parametrize(("kind", "full"), [(np.uint8, 255), (np.uint16, 4095)])
def test_8_bit_images_have_their_full_scale_for_peak_others_the_brightest_pixel(copy, kind, full):
    """12 bits stored in 16 do not gain 24 dB by it."""
    tops = []
    for path in copy.glob("images/*/*.tif"):
        pixels = np.round(tifffile.imread(path) / 4 * full).astype(kind)
        tops.append(pixels.max() / np.iinfo(kind).max)
        tifffile.imwrite(path, pixels)
    scan = load_scan(copy)
    found = data_range(scan, None, scan.images())
    assert found == pytest.approx(1 if full == 255 else max(tops), rel=1e-6)


def test_integer_images_have_full_scales_for_unit(copy, outcome):
    for path in copy.glob("images/*/*.tif"):
        pixels = tifffile.imread(path)
        tifffile.imwrite(path, np.round(pixels / 4 * 65535).astype(np.uint16))
    found = reconstruct(load_scan(copy), options=Options(hold_out=["cam02"], **SIRT))
    assert found.value_unit == found.report()["scan"]["value_unit"] == "full scales per mm"
    assert outcome.value_unit == "image units per mm"
    brightest = max(tifffile.imread(p).max() for p in copy.glob("images/*/*.tif")) / 65535
    assert outcome.data_range == pytest.approx(4 * brightest, rel=1e-3)
    assert found.data_range == pytest.approx(brightest, rel=1e-3)
    report = found.report()
    held_out, used = report["held_out"]["cam02"]["psnr"], report["views"]["cam01"]["psnr"]
    assert report["views"]["cam02"]["psnr"] == held_out
    assert used > held_out - 1


def test_dark_images_give_an_empty_volume_and_a_warning(copy):
    for path in copy.glob("images/*/*.tif"):
        tifffile.imwrite(path, np.zeros((60, 40), np.float32))
    found = reconstruct(load_scan(copy), options=Options(hold_out=["cam02"]))
    assert not found.solution.volume.any()
    assert any("the volume is empty" in warning for warning in found.warnings)
    json.dumps(found.report(), allow_nan=False)
