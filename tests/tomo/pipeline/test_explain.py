"""What is wrong with the images as a whole is found, corrected where asked, and said."""

import numpy as np
import pytest

from phantoms import GaussianBlobs
from rigs import ring
from rigs.scene.gas import ExtinctionVolume
from tomo import VoxelGrid, metrics
from tomo.pipeline import Options, reconstruct
from tomo.simulation import simulate_images
from tomo.simulation.effects import Effects

pytestmark = pytest.mark.usefixtures("quick_choices")

GRID = VoxelGrid((14, 20, 14), 1.0, (1.0, -2.0, 0.5))
RIG = ring(
    10, distance=200.0, image_size=(48, 60), footprint=0.5, center=GRID.center,
    pitch_degrees=[18.0, -12.0] * 5,
)  # fmt: skip
FIELD = GaussianBlobs(
    GRID.center + np.array([[-2.2, -3, 0.5], [1.8, 0, -1.4], [-0.5, 4, 1.2]]),
    [1.5, 1.7, 1.4],
    [1.0, 0.8, 0.6],
)
Q = 0.2
HELD_OUT = "cam04"


def scan_of(effects):
    return simulate_images(RIG, FIELD, GRID, effects=effects, supersample=2, refine=2).scan


@pytest.fixture(scope="module")
def absorbing():
    return scan_of(Effects(self_absorption=Q))


@pytest.fixture(scope="module")
def outcome(absorbing):
    return reconstruct(absorbing, options=Options(hold_out=[HELD_OUT], uncertainty=0))


def error(outcome):
    return metrics.nrmse(outcome.volume, outcome.truth)


def residual(outcome, name):
    (view,) = [one for one in outcome.views if one.name == name]
    return view.relative_residual


def test_self_absorption_is_corrected_and_said(outcome, absorbing):
    found = outcome.report()["explanation"]
    assert found["causes"] == ["self-absorption"]
    assert found["absorption"]["emission"] == pytest.approx(Q, rel=0.15)
    assert 0.02 < found["absorption"]["light_lost"] < 0.9
    assert outcome.gains is None
    (line,) = [line for line in outcome.warnings if "self-absorption" in line]
    assert "--no-fit-absorption" in line
    plain = reconstruct(
        absorbing,
        options=Options(
            fit_absorption=False, fit_gain=False, learn=False, hold_out=[HELD_OUT], uncertainty=0
        ),
    )
    assert error(outcome) < 0.5 * error(plain)
    assert plain.explanation is None


def test_cameras_held_out_are_seen_through_the_same_gas(outcome):
    others = [one.relative_residual for one in outcome.views if not one.held_out]
    assert residual(outcome, HELD_OUT) < 2 * np.median(others)


def test_nothing_is_corrected_with_a_named_method_unless_asked(absorbing):
    named = Options(method="mlem", iterations=5)
    assert reconstruct(absorbing, options=named).explanation is None
    asked = Options(method="mlem", iterations=20, fit_absorption=True, fit_gain=False)
    found = reconstruct(absorbing, options=asked).explanation
    assert found["causes"] == ["self-absorption"]


def test_gains_asked_for_are_fitted_whatever_the_images_say():
    found = reconstruct(
        scan_of(Effects()), options=Options(method="mlem", iterations=5, fit_gain=True)
    )
    assert found.gains is not None
    assert max(abs(g - 1) for g in found.gains["gain"].values()) < 0.02


def test_faultless_images_stay_as_given():
    found = reconstruct(scan_of(Effects()), options=Options(uncertainty=0))
    assert found.explanation["causes"] == []
    assert found.explanation["absorption"] is None
    assert found.gains is None
    assert not [line for line in found.warnings if "absor" in line or "gain" in line]


def test_what_images_do_not_tell_is_left_and_said():
    # every camera sees a ball alike, whether it absorbs its own light or not
    def ball(points):
        return (np.linalg.norm(points - np.array(GRID.center), axis=-1) < 5.5).astype(float)

    rig = ring(8, distance=200.0, image_size=(26, 32), footprint=0.9, center=GRID.center)
    scan = simulate_images(rig, ball, GRID, supersample=2, refine=4).scan
    found = reconstruct(scan, options=Options(uncertainty=0, align=False))
    assert found.explanation["causes"] == []
    undecided = found.explanation["undecided"]
    assert undecided["total"]["instead"] > 1.1 * undecided["total"]["taken"]
    (line,) = [line for line in found.warnings if "absorb" in line]
    assert "do not tell" in line
    assert "--fit-absorption" in line


def test_gains_are_not_taken_for_absorption():
    found = reconstruct(scan_of(Effects(gain_spread=0.1)), options=Options(uncertainty=0))
    assert found.explanation["causes"] == ["gain"]
    assert found.gains["disagreement"] > 0.04
    assert any("gains differ" in line for line in found.warnings)


def test_the_gas_is_found_and_corrected_on_the_fly(absorbing):
    how = {"method": "mlem", "iterations": 30, "fit_gain": False, "projector": "on-the-fly"}
    fitted, plain = (
        reconstruct(absorbing.scaled(2), options=Options(fit_absorption=wanted, **how))
        for wanted in (True, False)
    )
    assert fitted.explanation["causes"] == ["self-absorption"]
    assert error(fitted) < 0.7 * error(plain)


K = 0.05


@pytest.fixture(scope="module")
def clouded():
    rig = ring(6, distance=200.0, image_size=(26, 32), footprint=0.95, center=GRID.center)
    effects = Effects(absorption=K)
    coarse = VoxelGrid((10, 14, 10), 1.4, GRID.center)
    return simulate_images(rig, FIELD, coarse, effects=effects, supersample=2, refine=2).scan


def tried(outcome):
    return {cause for one in outcome.explanation["tried"] for cause in one["causes"]}


def test_a_known_medium_is_corrected_as_given(clouded):
    how = {"method": "mlem", "iterations": 30, "hold_out": [HELD_OUT]}
    given, plain = (reconstruct(clouded, options=Options(absorption=k, **how)) for k in (K, 0))
    assert error(given) < 0.6 * error(plain)
    assert residual(given, HELD_OUT) < 0.7 * residual(plain, HELD_OUT)
    assert given.explanation is None
    assert given.report()["settings"]["absorption"] == K


def test_no_medium_is_looked_for_beside_a_known_one(clouded):
    how = {"method": "mlem", "iterations": 5, "fit_absorption": True, "fit_gain": False}
    assert "medium" in tried(reconstruct(clouded, options=Options(**how)))
    assert "medium" not in tried(reconstruct(clouded, options=Options(absorption=K, **how)))


def test_gas_of_the_scene_is_corrected_and_no_absorption_is_looked_for(monkeypatch, clouded):
    smoke = ExtinctionVolume(np.full((1, 1, 1), K), clouded.grid.lower, clouded.grid.extent)
    named = {"method": "mlem", "iterations": 5}
    given = reconstruct(clouded, options=Options(absorption=K, **named))
    monkeypatch.setattr("tomo.pipeline.build.extinction_of", lambda rig: smoke)
    found = reconstruct(clouded, options=Options(**named))
    np.testing.assert_allclose(found.volume, given.volume, rtol=1e-3, atol=1e-5)
    # with pixels and voxels enlarged for the explanations, the gas is still there
    monkeypatch.setattr("tomo.pipeline.evidence.SEGMENTS", 10_000)
    default = reconstruct(clouded, options=Options(uncertainty=0, learn=False))
    assert tried(default) <= {"gain"}
    assert not [line for line in default.warnings if "absor" in line]
