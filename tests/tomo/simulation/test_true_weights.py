"""True weights of simulated scans, and the report of learned ones."""

import json
from dataclasses import replace

import numpy as np
import pytest
import yaml

from phantoms import create
from rigs import ring
from tomo import LinearSystem, VoxelGrid, load_scan
from tomo.io import read_volume
from tomo.operators.view_gains import Gains
from tomo.pipeline import Options, reconstruct
from tomo.report.outcome_files import write_outcome
from tomo.simulation import simulate_images
from tomo.simulation.effects import Effects
from tomo.simulation.true_weights import true_effects, true_ratios

pytestmark = pytest.mark.usefixtures("quick_choices")

GRID = VoxelGrid((10, 20, 10), 1.0, (1.0, -2.0, 0.5))
EFFECTS = Effects(absorption=0.25, gain_spread=0.05)
HELD_OUT = "cam03"


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    folder = tmp_path_factory.mktemp("absorbing") / "scan"
    rig = ring(
        12,
        distance=200.0,
        image_size=(40, 60),
        footprint=0.5,
        center=GRID.center,
        pitch_degrees=[20.0, -20.0] * 6,
    )
    field = create("jet", 1, GRID.extent, GRID.center)
    simulate_images(rig, field, GRID, effects=EFFECTS, seed=2).save(folder)
    return folder


@pytest.fixture(scope="module")
def outcome(folder):
    settings = {"fit_gain": False, "align": False, "hold_out": [HELD_OUT]}
    return reconstruct(
        load_scan(folder), options=Options(method="wernet", iterations=4, **settings)
    )


def test_true_weights_explain_the_images(folder):
    scan = load_scan(folder)
    system = LinearSystem.from_rig(scan.rig, GRID, midpoints=True)
    truth = read_volume(scan.truth)[0]
    ratios = true_ratios(system, true_effects(scan), truth)
    segments = system.projector.segments
    light = ratios * segments.length * truth.ravel()[segments.voxel]
    row = np.repeat(np.arange(segments.n_pixels), np.diff(segments.ptr))
    seen = np.bincount(row, light, segments.n_pixels)
    measured = system.flatten(scan.images())
    np.testing.assert_allclose(seen, measured, atol=2e-5 * measured.max())
    gains = np.linspace(0.5, 1.5, 12)
    corrected = Gains(gains, *np.zeros((3, 12)))
    left = true_ratios(system, true_effects(scan), truth, corrected)
    of_pixels = np.repeat(gains, np.diff(system.projector.view_ptr))[row]
    np.testing.assert_allclose(left * of_pixels, ratios)


def test_true_weights_need_effects_and_the_absorbing_gas(folder):
    system = LinearSystem.from_rig(load_scan(folder).rig, GRID, midpoints=True)
    assert true_ratios(system, None, None) is None
    assert true_ratios(system, (Effects(self_absorption=1.0), {}), None) is None
    assert (true_ratios(system, (Effects(), {}), None) == 1).all()


def test_effects_out_of_range_are_refused_before_anything_is_solved(folder, tmp_path):
    content = yaml.safe_load((folder / "scan.yaml").read_text())
    content["effects"]["absorption"] = -1.0
    (tmp_path / "scan.yaml").write_text(yaml.safe_dump(content))
    (tmp_path / "rig.yaml").write_bytes((folder / "rig.yaml").read_bytes())
    with pytest.raises(ValueError, match=r"scan\.yaml: effects: absorption: found -1\.0"):
        reconstruct(load_scan(tmp_path))


def test_learned_weights_are_reported_with_the_true_ones(outcome):
    report = json.loads(json.dumps(outcome.report()["learned"], allow_nan=False))
    learned = outcome.learned
    assert HELD_OUT not in report["cameras"]
    assert len(report["cameras"]) == 11
    residual = report["held_out_residual"]
    assert residual["learned"] < 0.95 * residual["segment_lengths"]
    assert 0.05 < report["explained"] < 1
    depth = learned.profiles[0]
    lit = depth.light > 0.05
    assert np.polyfit(depth.centre[lit], depth.weight[lit], 1)[0] < 0
    # the box absorbs: by the depth alone, but for the gains that have one mean
    slope = np.polyfit(depth.centre[lit], np.log(depth.truth[lit]), 1)[0]
    assert slope == pytest.approx(-EFFECTS.absorption, rel=0.1)


@pytest.mark.usefixtures("coarse_scenes")
def test_the_picture_is_written_where_weights_were_learned(outcome, tmp_path):
    write_outcome(tmp_path, outcome)
    assert (tmp_path / "learned.png").read_bytes().startswith(b"\x89PNG")
    page = (tmp_path / "report.html").read_text(encoding="utf-8")
    assert "Weights learned in place of segment lengths" in page
    assert "Dashed: the true ones" in page
    classic = replace(outcome, learned=None, views=(), truth=None)
    assert classic.report()["learned"] is None
    write_outcome(tmp_path, classic)
    assert not (tmp_path / "learned.png").exists()
    page = (tmp_path / "report.html").read_text(encoding="utf-8")
    assert "Weights learned in place" not in page
