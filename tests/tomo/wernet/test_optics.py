"""What the default WERNet is for: optics that no formula covers; and no harm without such."""

from functools import lru_cache

import numpy as np
import pytest

from tomo.selection import choose_by_left_out_pixels, solve_as_chosen
from tomo.wernet import Encoder, Rays, RayWeights, WernetSettings, save_encoder, wernet
from tomo.wernet.outer_iterations import EncoderTraining
from tomo.wernet.weights import corrections

pytestmark = pytest.mark.usefixtures("quick_choices")


@lru_cache
def learned(make, name):
    one = make(name)
    return wernet(one.projector, one.measured)


def classic(one):
    choice = choose_by_left_out_pixels(one.projector, one.measured)
    return solve_as_chosen(one.projector, one.measured, choice)


def error(one, solution):
    """Return the relative error of the voxels' means, times the best factor: no image tells it."""
    means, truth = one.projector.voxel_means(solution.volume), one.truth
    factor = (means * truth).sum() / (means * means).sum()
    return np.linalg.norm(factor * means - truth) / np.linalg.norm(truth)


@pytest.mark.parametrize(("name", "most"), [("waves", 0.5), ("direction", 0.3)])
def test_an_unknown_optic_is_learned_and_the_volume_comes_nearer_to_the_truth(optic, name, most):
    one, found = optic(name), learned(optic, name)
    assert found.settings["learned"] is True
    assert isinstance(found.weights, RayWeights)
    residual = found.settings["held_out_residual"]
    assert residual["learned"] < 0.4 * residual["segment_lengths"]
    assert error(one, found) < most * error(one, classic(one))


def test_a_faultless_scene_is_not_made_worse(optic):
    one, found = optic(), learned(optic, "")
    assert error(one, found) < 1.03 * error(one, classic(one))


def test_a_frozen_encoder_transfers_to_another_flame_by_the_same_optic(optic, tmp_path):
    """It is used as it is, from a file; one by another optic is refused by the left-out pixels."""
    path, other = tmp_path / "encoder.pt", optic("waves", turned=True)
    save_encoder(learned(optic, "waves").encoder, path)
    content = path.read_bytes()
    found = wernet(other.projector, other.measured, encoder=path, freeze_encoder=True)
    assert path.read_bytes() == content
    assert found.settings["learned"] is True
    assert found.settings["iterations"] == 0
    assert len(found.history) == 3  # lengths, the frozen weights, and these of all pixels
    residual = found.settings["held_out_residual"]
    assert residual["learned"] < 0.2 * residual["segment_lengths"]
    assert error(other, found) < 0.8 * error(other, classic(other))
    wrong = {"encoder": learned(optic, "direction").encoder, "freeze_encoder": True}
    refused = wernet(other.projector, other.measured, **wrong)
    assert refused.weights is None
    np.testing.assert_array_equal(refused.volume, classic(other).volume)


def test_no_factor_of_the_volume_hides_in_the_weights(optic):
    """The mean weight in each voxel is the mean length, over all rays that cross it."""
    rays, weights = optic("waves").projector.without_blur, learned(optic, "waves").weights
    sums = weights.projector(rays).column_sums / np.maximum(rays.column_sums, 1e-9)
    crossed = rays.column_sums > 0
    np.testing.assert_allclose(sums[crossed], 1, rtol=1e-4)
    ratio = weights.projector(rays).segments.length / rays.segments.length
    assert ratio.std() > 0.1


def test_emission_in_front_is_among_what_may_be_learned(scene):
    """At the true voxels, weights by the light between segment and camera are found again."""
    one = scene(image_size=(28, 40))
    segments, volume = one.projector.segments, one.truth.ravel().astype(np.float32)
    rays = Rays.of(one.projector, "optics").with_upstream(volume, 2.0)
    true = 1 / (1 + 0.5 * rays.features.of_segment[:, -1].numpy())
    measured = one.projector.with_lengths(segments.length * true) @ volume
    measured, none = measured.astype(np.float32), np.zeros(len(measured), bool)
    training = EncoderTraining(
        rays, measured, Encoder(silent=True), WernetSettings(), iterations=8, seed=0,
        map_parts=lambda function, parts: list(map(function, parts)), held=none,
    )  # fmt: skip
    losses = [training.train(n, rays, volume, np.zeros_like(measured)) for n in range(8)]
    assert losses[-1] < 0.05 * losses[0]
    found = np.square(1 + corrections(training.encoder, rays, training.map_parts))
    light = segments.length * volume[segments.voxel]
    apart = np.sqrt(light @ np.square(found - true) / light.sum())
    assert apart < 0.25 * np.sqrt(light @ np.square(1 - true) / light.sum())
