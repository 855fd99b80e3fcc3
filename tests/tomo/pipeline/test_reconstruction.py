import json
import math

import numpy as np
import pytest

from rigs import ring
from tomo import VoxelGrid
from tomo.pipeline import Options, Reconstruction
from tomo.pipeline.view import Peak, View, quality
from tomo.solvers import Iteration, Solution

RANDOM = np.random.default_rng(0)
MEASURED = RANDOM.random((20, 16)).astype(np.float32)


def test_a_view_s_gain_is_the_factor_that_fits_best():
    view = View("a", MEASURED, MEASURED / 1.25)
    assert view.gain == pytest.approx(1.25)
    assert view.relative_residual == pytest.approx(0.2)


@pytest.mark.parametrize("garbage", [1e6, np.nan, np.inf])
def test_masked_pixels_change_no_figure(garbage):
    mask = RANDOM.random(MEASURED.shape) < 0.7
    reprojected = MEASURED + RANDOM.normal(0, 0.1, MEASURED.shape).astype(np.float32)
    figures = []
    for filling in (0.0, garbage):
        view = View("a", np.where(mask, MEASURED, filling), reprojected, mask)
        figures.append((view.relative_residual, view.gain, view.similarity(1.0)))
    assert figures[0] == figures[1]


def test_a_dark_view_has_no_relative_figures():
    dark = np.zeros_like(MEASURED)
    assert math.isnan(View("a", dark, MEASURED).relative_residual)
    assert math.isnan(View("a", MEASURED, dark).gain)
    assert View("a", dark, MEASURED).similarity(1.0)["cosine"] == 0


def test_similarity_needs_no_window_where_the_image_is_too_small():
    view = View("a", MEASURED[:6], MEASURED[:6] + 0.1)
    assert "ssim" not in view.similarity(1.0)
    assert view.similarity(1.0)["psnr"] == pytest.approx(20, abs=1e-4)
    assert "ssim" in View("a", MEASURED, MEASURED).similarity(1.0)


@pytest.mark.parametrize("field", ["reprojected", "mask"])
def test_images_that_do_not_fit_on_each_other(field):
    parts = {"reprojected": MEASURED, "mask": None, field: np.ones((3, 3), bool)}
    with pytest.raises(ValueError, match=f"view left: {field}: found shape"):
        View("left", MEASURED, **parts)


def test_quality_of_a_scaled_truth():
    truth = RANDOM.random((4, 5, 6)).astype(np.float32)
    figures = quality(3 * truth, truth)
    assert figures["cosine_distance"] == pytest.approx(0, abs=1e-6)
    assert figures["total_ratio"] == pytest.approx(3)
    assert figures["nrmse"] > 1
    assert quality(truth, None) == {}


def test_a_report_is_json_whatever_is_in_it():
    grid = VoxelGrid((2, 3, 4), 1.0)
    rig = ring(1, image_size=(16, 20), footprint=1.0)
    found = Solution(
        np.zeros(grid.shape, np.float32),
        grid,
        (Iteration(0, math.inf, 0.0),),
        {"method": "sirt", "path": rig, "many": np.float32(0.5), "nested": {"a": (1, np.nan)}},
        quality={"cosine_distance": math.nan},
    )
    view = View("cam00", MEASURED, MEASURED, held_out=True)  # PSNR is infinite
    outcome = Reconstruction(
        found, rig, (view,), Peak(1.0, ""), warnings=("one",), options=Options(seed=3)
    )
    report = json.loads(json.dumps(outcome.report(), allow_nan=False))
    assert report["relative_residual"] is None
    assert report["quality"] == {"cosine_distance": None}
    assert report["held_out"]["cam00"]["psnr"] is None
    assert report["held_out"]["cam00"]["ssim"] == pytest.approx(1)
    assert report["solver"]["nested"] == {"a": [1, None]}
    assert report["solver"]["many"] == 0.5
    assert report["warnings"] == ["one"]
    assert report["seed"] == 3
