"""Whether the outer iterations of the default WERNet are worth their time."""

import numpy as np
import pytest

from tomo.simulation.effects import Effects
from tomo.wernet.default import wernet


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
    assert f"nothing{' more' if effects else ''} to learn" in found.stop_reason
    assert found.encoder is None
    assert found.settings["learned"] is (effects is not None)


def test_an_effect_that_no_term_explains_is_worth_outer_iterations(scene, small_steps):
    one = scene(finer=2)
    across = np.linspace(0.6, 1.4, 14, dtype=np.float32)  # a factor from left to right
    measured = one.system.flatten([across * image for image in one.scan.images.values()])
    found = wernet(one.projector, measured)
    assert len(found.history) > 3
    assert "to learn" not in found.stop_reason
    assert found.weights is not None
    assert not found.weights.encoder.is_zero
