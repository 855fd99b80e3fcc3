"""The default goes on to learned weights where segment lengths do not explain the images."""

import json
from dataclasses import replace

import numpy as np
import pytest

from phantoms import GaussianBlobs
from rigs import ring
from tomo import VoxelGrid, load_scan
from tomo.pipeline import Options, reconstruct
from tomo.simulation import simulate_images
from tomo.simulation.camera_noise import gaussian
from tomo.simulation.effects import Effects

GRID = VoxelGrid((16, 22, 16), 1.0)
PLACES = [[2.5, -4.0, 1.0], [-2.0, 4.5, -1.5], [0.5, 0.5, 3.0]]


def _scan(folder, views, effects=None):
    """Return a scan of three flames in 40 x 54 pixels, with a little noise, simulated finer."""
    look = {
        "image_size": (40, 54),
        "footprint": 0.45,
        "pitch_degrees": [14.0, -10.0] * (views // 2),
    }
    rig = ring(views, distance=60.0, center=GRID.center, start_degrees=5.0, **look)
    flame = GaussianBlobs(PLACES, [1.8, 2.2, 1.6], [1.0, 0.7, 0.8])
    made = simulate_images(rig, flame, GRID, supersample=2, refine=2, effects=effects, seed=13)
    images = gaussian(list(made.images.values()), 0.002, np.random.default_rng(5))
    made = replace(made, images=dict(zip(rig.names, images, strict=True)))
    return load_scan(made.save(folder))


def _nrmse(outcome):
    return outcome.solution.quality["nrmse"]


@pytest.mark.parametrize(("views", "uncertainty"), [(10, 0), (12, "auto")])
def test_vignetting_is_learned_and_corrected(tmp_path, views, uncertainty):
    scan = _scan(tmp_path / "scan", views, Effects(vignetting=0.4))
    how = {"hold_out": ["cam02"]}
    found = reconstruct(scan, options=Options(**how, uncertainty=uncertainty))
    plain = reconstruct(scan, options=Options(**how, uncertainty=0, learn=False))
    report = json.loads(json.dumps(found.report(), allow_nan=False))
    assert report["learning"]["taken"] is True
    assert report["learning"]["found"] == ["off the axis, squared"]
    residuals = report["learning"]["left_out_residual"]
    assert residuals["learned"] < residuals["segment_lengths"]
    assert report["learned"]["held_out_residual"] == residuals
    assert report["method"] == "curvature"
    assert _nrmse(found) < 0.8 * _nrmse(plain)
    psnr = [one.report()["held_out"]["cam02"]["psnr"] for one in (found, plain)]
    assert psnr[0] > psnr[1]
    line = next(line for line in found.warnings if line.startswith("vignetting: learned"))
    assert "--no-learn" in line
    assert plain.learning is None
    assert plain.report()["learning"] is None
    # what was learned is in the re-projected images and, where asked for, in the uncertainty
    own = [view for view in found.views if not view.held_out]
    missed = sum(np.square(view.measured - view.reprojected)[view.mask].sum() for view in own)
    light = sum(np.square(view.measured)[view.mask].sum() for view in own)
    assert np.sqrt(missed / light) == pytest.approx(found.solution.relative_residual, rel=0.1)
    if uncertainty:
        assert found.uncertainty.relative_deviation > 0
        assert report["uncertainty"]["intervals"] is not None


@pytest.mark.parametrize("views", [6, 12])
def test_a_faultless_scene_stays_as_it_is_to_the_bit(quick_choice, tmp_path, views):
    scan = _scan(tmp_path / "scan", views)
    found, plain = (
        reconstruct(scan, options=Options(uncertainty=0, learn=learn)) for learn in (True, False)
    )
    assert found.learning["taken"] is False
    assert found.learning["reason"]
    assert found.learned is None
    np.testing.assert_array_equal(found.solution.volume, plain.solution.volume)
    assert found.warnings == plain.warnings


def test_it_is_not_tried_where_it_cannot_be(quick_choice, folder):
    scan = load_scan(folder).scaled(2)
    few = reconstruct(scan, options=Options(uncertainty=0, hold_out=list(scan.rig.names[2:])))
    assert "too few views" in few.learning["reason"]
    forms = {"projector": "on-the-fly", "hold_out": list(scan.rig.names[:1])}
    on_the_fly = reconstruct(scan, options=Options(uncertainty=0, iterations=2, **forms))
    assert set(on_the_fly.report()["held_out"]) == {scan.rig.names[0]}
    assert "stored" in on_the_fly.learning["reason"]
    named = reconstruct(scan, options=Options(method="mlem", iterations=5))
    assert named.learning is None
