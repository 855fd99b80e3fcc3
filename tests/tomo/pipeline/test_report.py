"""What an outcome tells: figures, views, comparisons, warnings."""

import json

import numpy as np
import pytest
import tifffile
import yaml

from rigs.progress import stage_of
from tomo import Scan, load_scan
from tomo.pipeline import Options, reconstruct

pytestmark = pytest.mark.usefixtures("quick_choices", "quick_solves")

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
    assert report["warnings"] == []
    assert any("is a guess" in one for one in report["verdict"]["reasons"])  # cameras in pairs
    assert list(report["views"]) == [f"cam0{n}" for n in range(6)]
    assert report["versions"]["numpy"] == np.__version__
    assert report["seed"] == 0


@pytest.mark.parametrize("method", ["auto", "sirt"])
def test_progress_is_reported_all_the_way(folder, method):
    calls = []
    reconstruct(
        load_scan(folder),
        options=Options(method=method, screen=method == "auto"),
        progress=lambda *call: calls.append(call),
    )
    assert all(0 <= done <= total for done, total, _ in calls)
    where = [stage_of(place) for _, _, place in calls]
    stages = list(dict.fromkeys(stage for stage, _ in where))
    assert stages[:2] == ["reading", "compiling"]
    assert stages[-1] == "how far to trust it"
    assert [step for stage, step in where if stage == "tracing" and step] == [
        f"cam0{n}" for n in range(6)
    ]
    assert ("smoothness" in stages) == (method == "auto")
    assert "solve" in stages
    if method == "auto":
        done, total, name = calls[-1]
        assert done == total
        assert stage_of(name)[1] == "intervals"


SIRT = {"method": "sirt", "iterations": 5}


def test_comparisons_change_nothing(folder, volume_of, as_given):
    compare = ["wernet-paper:1", "mlem:3", "sart:2"]
    scan = load_scan(folder).scaled(2)
    found = reconstruct(scan, options=Options(compare=compare, **as_given))
    np.testing.assert_array_equal(found.solution.volume, volume_of(scan, **as_given))
    beside = found.report()["comparisons"]
    assert [one["method"] for one in beside] == ["wernet-paper", "mlem", "sart"]
    assert all(np.isfinite(one["quality"]["cosine_distance"]) for one in beside)
    # the curves of two runs of one method are not mixed up
    for run in (found.solution, *found.comparisons):
        assert run.history[-1].distance == pytest.approx(run.quality["cosine_distance"], rel=1e-3)
    assert found.seconds["compare"] > 0


@pytest.fixture
def stored(folder):
    """Return a function that stores the scan's images as grey levels, times a factor."""

    def run(kind, times):
        scan = load_scan(folder)
        images = {
            name: times * np.round(image / 4 * 255).astype(kind)
            for name, image in zip(scan.rig.names, scan.images(), strict=True)
        }
        return Scan.from_arrays(scan.rig, images, scan.grid)

    return run


def test_the_same_frame_has_the_same_psnr_whatever_bits_it_is_stored_in(stored, as_given):
    """The peak is the brightest pixel: 8 bits of 16 do not win 48 dB."""
    options = Options(hold_out=["cam02"], **SIRT, **as_given)
    eight, low, shifted = (
        reconstruct(stored(kind, times), options=options)
        for kind, times in ((np.uint8, 1), (np.uint16, 1), (np.uint16, 256))
    )
    figures = [one.report()["held_out"]["cam02"] for one in (eight, low, shifted)]
    for name, within in (("psnr", 0.05), ("ssim", 1e-3)):
        values = [one[name] for one in figures]
        assert values == pytest.approx(values[:1] * len(values), abs=within)
    assert eight.peak.origin == "brightest measured pixel"
    assert eight.peak.unit == "full scales"
    brightest = max(image.max() for image in stored(np.uint8, 1).images())
    assert eight.peak.value == pytest.approx(brightest, rel=1e-6)


def test_a_stated_peak_is_taken_and_reported(copy, folder, as_given):
    own, none = (Options(hold_out=["cam02"], peak=one, **SIRT, **as_given) for one in (8.0, None))
    content = yaml.safe_load((copy / "scan.yaml").read_text())
    (copy / "scan.yaml").write_text(yaml.safe_dump(content | {"peak": 4.0}))
    asked, of_scan, plain = (
        reconstruct(load_scan(path), options=options).report()
        for path, options in ((copy, own), (copy, none), (folder, none))
    )
    assert asked["peak"] == {"value": 8.0, "unit": "image units", "origin": "stated"}
    assert of_scan["peak"] == {"value": 4.0, "unit": "image units", "origin": "stated"}
    psnr = [one["held_out"]["cam02"]["psnr"] for one in (asked, of_scan, plain)]
    assert psnr[0] - psnr[1] == pytest.approx(20 * np.log10(2))
    assert psnr[1] - psnr[2] == pytest.approx(20 * np.log10(4 / plain["peak"]["value"]))


def test_a_peak_in_counts_is_refused_with_what_to_write(stored):
    with pytest.raises(ValueError, match=r"peak: found 65280, expected at most 1.* are 0\.996"):
        reconstruct(stored(np.uint16, 256), options=Options(peak=65280, **SIRT))


def test_integer_images_have_full_scales_for_unit(copy, outcome, as_given):
    for path in copy.glob("images/*/*.tif"):
        pixels = tifffile.imread(path)
        tifffile.imwrite(path, np.round(pixels / 4 * 65535).astype(np.uint16))
    found = reconstruct(load_scan(copy), options=Options(hold_out=["cam02"], **SIRT, **as_given))
    assert found.value_unit == found.report()["scan"]["value_unit"] == "full scales per mm"
    assert outcome.value_unit == "image units per mm"
    brightest = max(tifffile.imread(p).max() for p in copy.glob("images/*/*.tif")) / 65535
    assert outcome.peak.value == pytest.approx(4 * brightest, rel=1e-3)
    assert found.peak.value == pytest.approx(brightest, rel=1e-3)
    report = found.report()
    held_out, used = report["held_out"]["cam02"]["psnr"], report["views"]["cam01"]["psnr"]
    assert report["views"]["cam02"]["psnr"] == held_out
    assert used > held_out - 1
