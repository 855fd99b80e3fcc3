"""The default's encoder: given, frozen, trained on, handed back."""

import sys
from functools import lru_cache

import numpy as np
import pytest
import torch

from tomo.selection import choose_by_left_out_pixels, solve_as_chosen
from tomo.simulation.effects import Effects
from tomo.wernet import save_encoder
from tomo.wernet.default import CorrectionEncoder, wernet

pytestmark = pytest.mark.usefixtures("quick_choices")

GAINS = Effects(gain_spread=0.1)
OWN_LIGHT = Effects(self_absorption=0.2)


def _across(one):
    """Return the images times a factor from left to right, which no term explains."""
    factor = np.linspace(0.6, 1.4, one.rig[0].image_size[0], dtype=np.float32)
    return one.system.flatten([factor * image for image in one.scan.images.values()])


@lru_cache
def _trained(make):
    """Return what is learned of the factor."""
    one = make(finer=2)
    return wernet(one.projector, _across(one), iterations=8)


@lru_cache
def _classic(make):
    """Return the volume of the classic solve of images whose gains differ."""
    one = make(effects=GAINS)
    choice = choose_by_left_out_pixels(one.projector, one.measured)
    return solve_as_chosen(one.projector, one.measured, choice).volume


def test_a_learned_encoder_is_used_again_frozen(scene, tmp_path):
    one, trained = scene(finer=2), _trained(scene)
    measured = _across(one)
    learned, path = trained.weights, tmp_path / "encoder.pt"
    assert trained.encoder is learned.encoder
    save_encoder(trained.encoder, path)
    content = path.read_bytes()
    seen = []
    found = wernet(
        one.projector,
        measured,
        encoder=path,
        freeze_encoder=True,
        callback=lambda index, volume, residual: seen.append(index),
    )
    assert path.read_bytes() == content
    assert [p.name for p in tmp_path.iterdir()] == ["encoder.pt"]
    assert seen[:2] == [0, 1]
    assert len(seen) <= 3  # the classic solve once more, should it be kept
    assert found.settings["encoder"] == str(path)
    assert found.settings["freeze_encoder"] is True
    if found.weights is not None:
        for name, value in learned.encoder.state_dict().items():
            assert torch.equal(found.weights.encoder.state_dict()[name], value)
    in_memory = wernet(one.projector, measured, encoder=learned.encoder, freeze_encoder=True)
    np.testing.assert_array_equal(in_memory.volume, found.volume)


def test_an_encoder_in_memory_or_in_a_file_is_not_changed_by_training(scene, tmp_path):
    one, path = scene(effects=GAINS), tmp_path / "encoder.pt"
    encoder = CorrectionEncoder(blocks=1, channels=8, seed=4)
    save_encoder(encoder, path)
    content = path.read_bytes()
    before = {name: value.clone() for name, value in encoder.state_dict().items()}
    found, from_file, fresh = (
        wernet(one.projector, one.measured, seed=4, iterations=2, **given)
        for given in ({"encoder": encoder}, {"encoder": path}, {"blocks": 1, "channels": 8})
    )
    assert all(torch.equal(before[name], value) for name, value in encoder.state_dict().items())
    assert not encoder.last.weight.requires_grad or encoder.last.weight.grad is None
    assert path.read_bytes() == content
    assert found.settings["encoder"] == "in memory"
    assert (found.settings["blocks"], found.settings["channels"]) == (1, 8)
    np.testing.assert_array_equal(found.volume, fresh.volume)
    np.testing.assert_array_equal(from_file.volume, fresh.volume)


def test_an_encoder_predicts_another_flame_by_the_same_optics_and_does_others_no_harm(scene):
    alike = scene(finer=2, views=14)
    other = scene(effects=OWN_LIGHT, views=14, finer=2)
    encoder = _trained(scene).encoder
    frozen = {"encoder": encoder, "freeze_encoder": True}
    found = wernet(alike.projector, _across(alike), **frozen)
    assert found.settings["freeze_encoder"] is True
    residual = found.settings["held_out_residual"]
    assert found.settings["learned"] is True
    assert residual["learned"] < residual["segment_lengths"]
    lengths = wernet(other.projector, other.measured, iterations=0)
    found = wernet(other.projector, other.measured, **frozen)
    residual = found.settings["held_out_residual"]
    assert residual["learned"] > residual["segment_lengths"]
    np.testing.assert_array_equal(found.volume, lengths.volume)


def test_a_frozen_encoder_is_evaluated_and_solved_as_segment_lengths_were(scene, monkeypatch):
    """Choosing anew took longer than all else."""
    one, made = scene(effects=OWN_LIGHT), []
    encoder = CorrectionEncoder(seed=1)
    torch.nn.init.normal_(
        encoder.last.weight, 0.0, 0.01, generator=torch.Generator().manual_seed(1)
    )

    def noted(*arguments, **how):
        made.append(choose_by_left_out_pixels(*arguments, **how))
        return made[-1]

    module = sys.modules["tomo.wernet.default.wernet"]
    monkeypatch.setattr(module, "choose_by_left_out_pixels", noted)
    found = wernet(one.projector, one.measured, encoder=encoder, freeze_encoder=True)
    assert len(made) == 1
    assert found.settings["solved_by"]["iterations"] == made[0].iterations


def test_where_only_parametric_terms_are_kept_there_is_no_encoder(scene):
    one = scene(effects=GAINS)
    found = wernet(one.projector, one.measured, iterations=1)
    assert found.weights.encoder.is_zero
    assert found.encoder is None


@pytest.mark.parametrize("value", [1e4, 1e10, np.nan])
@pytest.mark.parametrize("freeze", [False, True], ids=["trained", "frozen"])
def test_an_encoder_that_explodes_leaves_the_classic_solve(scene, value, freeze):
    """It ended in the classic solve's own error, or in a volume of its wild weights."""
    one = scene(effects=GAINS)
    encoder = CorrectionEncoder(blocks=1, channels=4)
    with torch.no_grad():
        for parameter in encoder.parameters():
            parameter.fill_(value)
    found = wernet(
        one.projector, one.measured, encoder=encoder, freeze_encoder=freeze, iterations=1
    )
    np.testing.assert_array_equal(found.volume, _classic(scene))
    assert found.weights is None
    assert "diverged in " in found.stop_reason
    assert all(np.isfinite(entry.relative_residual) for entry in found.history)
