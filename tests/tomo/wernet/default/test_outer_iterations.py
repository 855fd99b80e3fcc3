"""When the rounds of the default WERNet are worth their time."""

import math

import numpy as np
import pytest
import torch

from tomo.simulation.effects import Effects
from tomo.wernet.default import CorrectionEncoder, RayFeatures, ViewTokens, wernet
from tomo.wernet.default.alternation import LAST_STEPS, Alternation, Training
from tomo.wernet.micro_batches import on_cores


@pytest.fixture
def small_steps(monkeypatch):
    """Let a small scene have rays for all the steps of a round."""
    monkeypatch.setattr("tomo.wernet.default.alternation.RAYS_A_STEP", 100)


@pytest.mark.parametrize("effects", [None, Effects(gain_spread=0.1)], ids=["chords", "gains"])
def test_what_levels_and_trends_explain_leaves_an_encoder_nothing(scene, small_steps, effects):
    one = scene(effects=effects, finer=2)
    found = wernet(one.projector, one.measured)
    assert found.stop_reason.startswith("nothing more to" if effects else "nothing to")
    assert len(found.history) == (2 if effects else 1)
    assert found.settings["learned"] is (effects is not None)
    assert math.isnan(found.settings["held_out_residual"]["learned"]) is (effects is None)


def test_what_levels_and_trends_do_not_explain_is_worth_rounds(scene, small_steps):
    one = scene(finer=2)
    across = np.linspace(0.6, 1.4, 14, dtype=np.float32)  # of pixels, from left to right
    measured = one.system.flatten([across * image for image in one.scan.images.values()])
    found = wernet(one.projector, measured)
    assert len(found.history) > 3
    assert "to learn" not in found.stop_reason
    assert found.weights is not None
    assert not found.weights.encoder.is_zero


def test_the_share_of_the_misfit_is_of_the_same_rays():
    others = np.arange(12.0)
    rays = [torch.tensor([2 * step, 2 * step + 1]) for step in range(LAST_STEPS)]
    misfits = [float(others[pair].mean()) / 4 for pair in rays]
    assert Training(1.0, rays, misfits).share_of(others) == pytest.approx(0.5)
    assert Training(1.0, [], []).share_of(others) == 0
    assert Training(1.0, rays, misfits).share_of(0 * others) == math.inf


def test_light_of_neighbours_is_nothing_to_learn_of_a_line(scene, small_steps):
    one = scene(finer=2)
    splines = one.system.with_linear_basis().projector
    volume = np.random.default_rng(3).random(splines.shape[1]).astype(np.float32)
    measured, alone = splines @ volume, splines.without_blur @ volume
    features = RayFeatures.of(splines, torch.device("cpu"), tells_views=False)
    front = features.emission_in_front(volume, 1.0)

    def misfits(beside):
        encoder = CorrectionEncoder(seed=1)
        tokens = ViewTokens(splines.n_views, encoder.channels)
        with on_cores(torch.device("cpu")) as over_parts:
            how = {"rounds": 1, "seed": 0, "over_parts": over_parts}
            alternation = Alternation(features, measured, encoder, tokens, **how)
            return alternation.round(0, volume, front, beside).misfits

    assert max(misfits(measured - alone)) < 0.02 * min(misfits(None))
