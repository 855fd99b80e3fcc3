"""The default method with outlier pixels and inconsistent views, from scan to report."""

import numpy as np
import pytest

import phantoms
import rigs
from tomo import VoxelGrid, load_scan
from tomo.pipeline import Options, reconstruct
from tomo.scan import save_scan
from tomo.simulation import simulate_images

GRID = VoxelGrid((16, 24, 16), 1.0)


@pytest.fixture(scope="module")
def made():
    rig = rigs.ring(12, distance=300.0, image_size=(48, 60), footprint=0.5, pitch_degrees=12)
    field = phantoms.create("turbulent", seed=3, extent=GRID.extent)
    return simulate_images(rig, field, GRID, supersample=2, refine=2)


@pytest.fixture
def run(made, tmp_path):
    def reconstructed(images, **settings):
        save_scan(tmp_path / "s", made.rig, {"f": images}, grid=GRID, truth=made.truth)
        scan = load_scan(tmp_path / "s")
        return reconstruct(scan, options=Options(uncertainty=0, **settings))

    return reconstructed


def test_a_wrong_view_is_named_and_costs_no_more_than_its_absence(made, run):
    images = dict(made.images)
    images["cam03"] = np.ascontiguousarray(images["cam03"][::-1])
    outcome = run(images)
    report = outcome.report()
    assert report["screening"]["excluded"] == ["cam03"]
    causes = report["screening"]["cameras"]["cam03"]["causes"]
    assert causes[0]["words"] == "mirrored upside down"
    assert causes[0]["leaves"] < 0.2
    assert report["views"]["cam03"]["excluded"]
    assert not report["views"]["cam03"]["held_out"]
    assert not report["views"]["cam04"]["excluded"]
    assert "cam03" not in report["held_out"]
    assert len(outcome.views) == 12
    assert any(w.startswith("camera cam03: ") and "upside down" in w for w in outcome.warnings)


def test_screening_can_be_switched_off(made, run):
    images = dict(made.images)
    images["cam03"] = np.ascontiguousarray(images["cam03"][::-1])
    kept = run(images, screen=False)
    assert kept.report()["screening"] is None
    assert not any(view.excluded for view in kept.views)


def test_a_wrong_view_held_out_stays_held_out(made, run):
    images = dict(made.images)
    images["cam03"] = np.ascontiguousarray(images["cam03"][::-1])
    report = run(images, hold_out=["cam03"]).report()
    assert report["screening"]["excluded"] == []
    assert list(report["screening"]["cameras"]) == ["cam03"]
    assert list(report["held_out"]) == ["cam03"]
    assert any(w.startswith("camera cam03: ") for w in report["warnings"])


def test_outlier_pixels_are_excluded_and_reported(made, run):
    random = np.random.default_rng(0)
    top = max(float(image.max()) for image in made.images.values())
    images = {
        name: np.where(random.random(image.shape) < 0.01, 3 * top, image).astype(np.float32)
        for name, image in made.images.items()
    }
    clean = run(dict(made.images)).solution.quality["nrmse"]
    outcome = run(images)
    assert outcome.solution.quality["nrmse"] < 1.2 * clean
    assert sum(outcome.screening["outlier_pixels"].values()) > 0.008 * 12 * 48 * 60
    assert any("of the pixels are outliers" in warning for warning in outcome.warnings)


def test_a_held_out_view_is_evaluated_without_its_outlier_pixels(made, run):
    image = made.images["cam03"]
    wild = np.random.default_rng(0).random(image.shape) < 0.01
    images = {**made.images, "cam03": np.where(wild, 30 * image.max(), image).astype(np.float32)}
    clean, found = (
        run(dict(one), hold_out=["cam03"]).report()["held_out"]["cam03"]
        for one in (made.images, images)
    )
    assert found["psnr"] == pytest.approx(clean["psnr"], abs=0.5)
    assert found["cosine"] == pytest.approx(clean["cosine"], abs=1e-3)


def test_an_excluded_view_does_not_set_the_range_of_the_others(made, run):
    images = {**made.images, "cam03": 30 * np.ascontiguousarray(made.images["cam03"][::-1])}
    held_out = [
        run(dict(one), hold_out=["cam07"]).report()["held_out"]["cam07"]["psnr"]
        for one in (images, {**images, "cam03": images["cam03"] / 30})
    ]
    assert held_out[0] == pytest.approx(held_out[1], abs=1e-6)


def test_nothing_is_excluded_of_consistent_images(made, run):
    outcome = run(dict(made.images))
    assert outcome.screening["excluded"] == []
    assert not any(outcome.screening["outlier_pixels"].values())
    assert not any("agrees" in warning for warning in outcome.warnings)
    again = run(dict(made.images), screen=False)
    assert np.array_equal(outcome.volume, again.volume)


def test_the_command_screens_nothing_on_request(made, run_tool, tmp_path):
    images = dict(made.images)
    images["cam03"] = np.ascontiguousarray(images["cam03"][::-1])
    save_scan(tmp_path / "s", made.rig, {"f": images}, grid=GRID)
    arguments = ["reconstruct", tmp_path / "s", "-o", tmp_path / "out", "--method", "sirt"]
    found = run_tool(*arguments, "--iterations", 2)
    assert found.exit_code == 0
    assert "camera cam03: its image differs" in found.stderr
    kept = run_tool(*arguments, "--iterations", 2, "--no-screen")
    assert kept.exit_code == 0
    assert "cam03: its image" not in kept.stderr
