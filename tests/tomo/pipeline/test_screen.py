"""The default method with outlier pixels and inconsistent views, from scan to report."""

import numpy as np
import pytest

import phantoms
import rigs
from tomo import VoxelGrid, load_scan
from tomo.pipeline import Options, reconstruct
from tomo.scan import save_scan
from tomo.simulation import simulate_images

pytestmark = pytest.mark.usefixtures("quick_choices", "quick_solves")

GRID = VoxelGrid((12, 18, 12), 1.0)


@pytest.fixture(scope="module")
def made():
    rig = rigs.ring(8, distance=300.0, image_size=(28, 34), footprint=0.667, pitch_degrees=12)
    field = phantoms.create("turbulent", seed=2, extent=GRID.extent)
    return simulate_images(rig, field, GRID, supersample=2, refine=2)


SIRT = {"method": "sirt", "iterations": 20}
QUICK = {**SIRT, "refine_cameras": "none", "fit_gain": False}  # only what is screened counts


@pytest.fixture(scope="module")
def run(made, tmp_path_factory):
    folder = tmp_path_factory.mktemp("screened")

    def reconstructed(images, **settings):
        save_scan(folder / "s", made.rig, {"f": images}, grid=GRID, truth=made.truth)
        scan = load_scan(folder / "s")
        return reconstruct(scan, options=Options(uncertainty=0, **settings))

    return reconstructed


@pytest.fixture(scope="module")
def clean(made, run):
    return run(dict(made.images))


@pytest.fixture(scope="module")
def mirrored(made):
    return {**made.images, "cam03": np.ascontiguousarray(made.images["cam03"][::-1])}


def test_an_image_turned_over_is_named_and_turned_back(mirrored, made, run, clean):
    outcome = run(mirrored)
    report = outcome.report()
    (found,) = report["findings"]
    assert (found["effect"], found["camera"], found["other"]) == (
        "mirrored",
        "cam03",
        "up and down",
    )
    assert report["screening"]["excluded"] == []
    assert not report["views"]["cam03"]["excluded"]
    assert len(outcome.views) == len(made.rig)
    assert any(w.startswith("camera cam03: its image is turned over") for w in outcome.warnings)
    assert outcome.solution.quality["nrmse"] < 1.01 * clean.solution.quality["nrmse"]


@pytest.fixture(scope="module")
def doubled(made):
    return {**made.images, "cam04": made.images["cam03"]}


def test_of_two_cameras_with_one_image_the_wrong_one_is_left_out(doubled, run, made):
    outcome = run(doubled, **SIRT)
    report = outcome.report()
    assert report["screening"]["excluded"] == ["cam04"]
    assert report["views"]["cam04"]["excluded"]
    assert not report["views"]["cam04"]["held_out"]
    assert not report["views"]["cam03"]["excluded"]
    assert "cam04" not in report["held_out"]
    assert len(outcome.views) == len(made.rig)
    said = [line for line in outcome.warnings if "its image is that of camera" in line]
    assert [line.partition(" too")[0] for line in said] == [
        "camera cam04: its image is that of camera cam03"
    ]
    absent = run(dict(made.images), hold_out=["cam04"], **SIRT)
    np.testing.assert_array_equal(outcome.volume, absent.volume)


def test_both_are_left_out_where_the_others_do_not_tell(made, run):
    random = np.random.default_rng(0)
    loud = 0.3 * max(float(image.max()) for image in made.images.values())
    images = {
        name: (image + loud * random.standard_normal(image.shape)).astype(np.float32)
        for name, image in made.images.items()
    }
    outcome = run({**images, "cam04": images["cam03"]}, **SIRT)
    assert outcome.report()["screening"]["excluded"] == ["cam03", "cam04"]


def test_screening_can_be_switched_off(mirrored, run):
    kept = run(mirrored, screen=False, **QUICK)
    assert kept.report()["screening"] is None
    assert not any(view.excluded for view in kept.views)


def test_a_wrong_view_held_out_stays_held_out(mirrored, run):
    outcome = run(mirrored, hold_out=["cam03"], **SIRT)
    report = outcome.report()
    assert report["screening"]["excluded"] == []
    assert list(report["held_out"]) == ["cam03"]
    assert report["held_out"]["cam03"]["fitted"]["beyond_noise"] > 0.3
    assert any("held-out camera cam03" in line for line in outcome.verdict.reasons)


def test_outlier_pixels_are_excluded_and_reported(made, run, clean):
    random = np.random.default_rng(0)
    top = max(float(image.max()) for image in made.images.values())
    images = {
        name: np.where(random.random(image.shape) < 0.01, 3 * top, image).astype(np.float32)
        for name, image in made.images.items()
    }
    outcome = run(images)
    assert outcome.solution.quality["nrmse"] < 1.2 * clean.solution.quality["nrmse"]
    assert sum(outcome.screening["outlier_pixels"].values()) > 0.008 * sum(
        image.size for image in images.values()
    )
    assert {one.effect for one in outcome.findings} == {"bad pixels"}


def test_a_held_out_view_is_evaluated_without_its_outlier_pixels(made, run):
    image = made.images["cam03"]
    wild = np.random.default_rng(0).random(image.shape) < 0.01
    images = {**made.images, "cam03": np.where(wild, 30 * image.max(), image).astype(np.float32)}
    clean, found = (
        run(dict(one), hold_out=["cam03"], **QUICK).report()["held_out"]["cam03"]
        for one in (made.images, images)
    )
    assert found["psnr"] == pytest.approx(clean["psnr"], abs=0.5)
    assert found["cosine"] == pytest.approx(clean["cosine"], abs=1e-3)


def test_an_excluded_view_does_not_set_the_range_of_the_others(doubled, run):
    held_out = []
    for factor in (30, 1):
        bright = {name: factor * doubled[name] for name in ("cam03", "cam04")}
        report = run({**doubled, **bright}, hold_out=["cam07"], **QUICK).report()
        held_out.append(report["held_out"]["cam07"]["psnr"])
    assert held_out[0] == pytest.approx(held_out[1], abs=1e-6)


def test_nothing_is_excluded_of_consistent_images(made, run, clean):
    outcome = clean
    assert outcome.screening["excluded"] == []
    assert not any(outcome.screening["outlier_pixels"].values())
    assert outcome.findings == ()
    again = run(dict(made.images), screen=False)
    assert np.array_equal(outcome.volume, again.volume)
