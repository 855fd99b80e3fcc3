"""Whether the outer iterations of the default WERNet are worth their time."""

import math

import numpy as np
import pytest
import torch

from tomo.simulation.effects import Effects
from tomo.wernet.default import CorrectionEncoder, RayFeatures, ViewParameters, wernet
from tomo.wernet.default.encoder_training import LAST_STEPS, EncoderTraining, TrainingResult
from tomo.wernet.micro_batches import chunk_map


@pytest.fixture
def small_steps(monkeypatch):
    """Let a small scene have rays for all the steps of an outer iteration."""
    monkeypatch.setattr("tomo.wernet.default.encoder_training.RAYS_PER_STEP", 100)


@pytest.mark.parametrize(
    "effects", [None, Effects(gain_spread=0.1)], ids=["segment_lengths", "gains"]
)
def test_effects_that_terms_explain_leave_an_encoder_nothing(scene, small_steps, effects):
    one = scene(effects=effects, finer=2)
    found = wernet(one.projector, one.measured)
    assert found.stop_reason.startswith("nothing more to" if effects else "nothing to")
    assert len(found.history) == (2 if effects else 1)
    assert found.settings["learned"] is (effects is not None)
    assert math.isnan(found.settings["held_out_residual"]["learned"]) is (effects is None)


def test_an_effect_that_no_term_explains_is_worth_outer_iterations(scene, small_steps):
    one = scene(finer=2)
    across = np.linspace(0.6, 1.4, 14, dtype=np.float32)  # a factor from left to right
    measured = one.system.flatten([across * image for image in one.scan.images.values()])
    found = wernet(one.projector, measured)
    assert len(found.history) > 3
    assert "to learn" not in found.stop_reason
    assert found.weights is not None
    assert not found.weights.encoder.is_zero


def test_the_misfit_ratio_compares_the_same_rays():
    others = np.arange(12.0)
    rays = [torch.tensor([2 * step, 2 * step + 1]) for step in range(LAST_STEPS)]
    misfits = [float(others[pair].mean()) / 4 for pair in rays]
    assert TrainingResult(1.0, rays, misfits).misfit_ratio(others) == pytest.approx(0.5)
    assert TrainingResult(1.0, [], []).misfit_ratio(others) == 0
    assert TrainingResult(1.0, rays, misfits).misfit_ratio(0 * others) == math.inf


def test_light_of_neighbouring_rays_is_not_learned_as_a_ray_s_own(scene, small_steps):
    one = scene(finer=2)
    linear = one.system.with_linear_basis().projector
    volume = np.random.default_rng(3).random(linear.shape[1]).astype(np.float32)
    measured, alone = linear @ volume, linear.without_blur @ volume
    features = RayFeatures.of(linear, torch.device("cpu"), per_view=False)
    upstream = features.upstream_emission(volume, 1.0)

    def misfits(neighbours):
        encoder = CorrectionEncoder(seed=1)
        view_parameters = ViewParameters(linear.n_views, encoder.channels)
        with chunk_map(torch.device("cpu")) as map_chunks:
            how = {"iterations": 1, "seed": 0, "map_chunks": map_chunks}
            training = EncoderTraining(features, measured, encoder, view_parameters, **how)
            return training.train(0, volume, upstream, neighbours).misfits

    assert max(misfits(measured - alone)) < 0.02 * min(misfits(None))
