"""The default WERNet as a solver: its record, its options, and what it refuses."""

from functools import lru_cache

import numpy as np
import pytest
import torch

from tomo import LinearSystem
from tomo.grid import ActiveVoxels
from tomo.selection import choose_by_left_out_pixels, solve_as_chosen
from tomo.selection.left_out import LeftOut
from tomo.wernet import Encoder, Rays, WernetSettings, outer_iterations, save_encoder, wernet
from tomo.wernet.outer_iterations import EncoderTraining
from tomo.wernet.wernet import FEW_VIEW_FEATURES

pytestmark = pytest.mark.usefixtures("quick_choices")


@pytest.fixture(scope="module")
def shaded(scene):
    """Return images that are brighter on their right, which no effect explains."""
    return scene(shading=0.4)


@lru_cache
def learned(make, iterations=2):
    one = make(shading=0.4)
    return wernet(one.projector, one.measured, iterations=iterations)


@lru_cache
def classic(make, shading=0.4):
    one = make(shading=shading)
    choice = choose_by_left_out_pixels(one.projector, one.measured)
    return solve_as_chosen(one.projector, one.measured, choice)


def assert_classic(found, expected):
    """Check that a result is the classic solve to the bit, and that it is reported."""
    np.testing.assert_array_equal(found.volume, expected.volume)
    assert found.weights is None
    assert found.encoder is None
    assert found.settings["learned"] is False
    assert "segment lengths are kept" in found.stop_reason


def test_volume_and_weights_of_a_solution_belong_together(scene, shaded):
    found = learned(scene)
    assert found.settings["method"] == "wernet"
    assert found.settings["learned"] is True
    assert found.encoder is found.weights.encoder
    assert found.volume.dtype == np.float32
    assert found.volume.min() >= 0
    misfits = [
        np.linalg.norm(operator @ found.volume.ravel() - shaded.measured)
        / np.linalg.norm(shaded.measured)
        for operator in (found.weights.projector(shaded.projector), shaded.projector)
    ]
    assert misfits[0] == pytest.approx(found.relative_residual, rel=1e-3)
    assert misfits[0] < 0.9 * misfits[1]
    assert found.volume.sum() == pytest.approx(shaded.truth.sum(), rel=0.05)


def test_the_volume_is_as_smooth_as_where_its_weights_were_judged(shaded, monkeypatch):
    """Chosen anew, it would be by pixels that the encoder learned from, and less smooth."""
    chosen, choose = [], LeftOut.choose
    monkeypatch.setattr(outer_iterations, "HALVED", 0.0)
    monkeypatch.setattr(LeftOut, "choose", lambda *how: chosen.append(choose(*how)) or chosen[-1])
    found = wernet(shaded.projector, shaded.measured, iterations=2)
    assert found.settings["learned"] is True
    assert len(chosen) == 1
    assert found.settings["solved_by"]["strength"] == chosen[0].strength


def test_true_segment_lengths_are_kept_to_the_bit(scene):
    one = scene()
    found = wernet(one.projector, one.measured)
    assert_classic(found, classic(scene, 0.0))
    assert "nothing to learn after outer iteration 2" in found.stop_reason


def test_the_same_bits_again_and_for_any_number_of_threads(scene, shaded, on_threads):
    found = [learned(scene)]  # on one thread
    with on_threads(4):
        found.append(wernet(shaded.projector, shaded.measured, iterations=2))
        assert torch.get_num_threads() == 4
    lengths = [each.weights.projector(shaded.projector).segments.length for each in found]
    np.testing.assert_array_equal(*lengths)
    np.testing.assert_array_equal(found[1].volume, found[0].volume)
    assert found[1].settings == found[0].settings
    residuals = [[entry.relative_residual for entry in each.history] for each in found]
    assert residuals[0] == residuals[1]


def test_the_seed_decides_and_the_global_state_is_left_alone(scene, shaded):
    state, drawn = torch.get_rng_state(), np.random.get_state()[1].copy()  # noqa: NPY002
    other = wernet(shaded.projector, shaded.measured, iterations=1, seed=2)
    assert torch.equal(torch.get_rng_state(), state)
    assert np.array_equal(np.random.get_state()[1], drawn)  # noqa: NPY002
    residuals = [
        [entry.relative_residual for entry in each.history] for each in (learned(scene), other)
    ]
    assert residuals[0][0] == residuals[1][0]  # the classic solve
    assert residuals[0][1] != residuals[1][1]


@pytest.mark.parametrize("views", [1, 2])
def test_with_too_few_views_segment_lengths_are_kept(scene, views):
    one = scene(views=views, image_size=(7, 10))
    found = wernet(one.projector, one.measured)
    assert found.weights is None
    assert "too few views" in found.stop_reason


def test_views_that_see_nothing_do_not_count(scene):
    one = scene(views=3)
    masks = [np.ones((20, 14), bool), np.ones((20, 14), bool), np.zeros((20, 14), bool)]
    system = LinearSystem.from_rig(one.rig, one.grid, masks=masks, midpoints=True)
    measured = system.flatten(list(one.scan.images.values()))
    assert "too few views" in wernet(system.projector, measured).stop_reason


def test_dark_images_give_an_empty_volume(scene):
    one = scene()
    found = wernet(one.projector, np.zeros_like(one.measured))
    assert not found.volume.any()
    assert found.weights is None
    assert "the images are dark" in found.stop_reason


def test_through_a_lens_nothing_is_trained(scene):
    one = scene()
    found = wernet(one.system.with_lens_blur(3.0).projector, one.measured)
    assert found.weights is None
    assert "no encoder is trained through a lens blur" in found.stop_reason


@pytest.mark.parametrize("views", [6, 12])
def test_few_views_show_an_encoder_nothing_that_tells_them_apart(scene, views):
    one = scene(views=views)
    found = wernet(one.projector, one.measured, iterations=0)
    assert found.settings["shown"] == (FEW_VIEW_FEATURES if views == 6 else None)


def test_every_setting_of_training_is_used(shaded):
    volume, one = shaded.truth.ravel().astype(np.float32), shaded.measured
    rays = Rays.of(shaded.projector, "optics")

    def trained(**settings):
        training = EncoderTraining(
            rays, one, Encoder(silent=True), WernetSettings(**settings), iterations=2, seed=0,
            map_parts=lambda function, parts: list(map(function, parts)), held=one < 0,
        )  # fmt: skip
        for number in range(2):
            training.train(number, rays, volume, np.zeros_like(one))
        return training.encoder.last.weight

    usual = trained()
    assert torch.equal(trained(), usual)
    for settings in (
        {"steps": 3}, {"rays_per_step": 20}, {"penalty": 0.5}, {"learning_rate": 0.1},
        {"last_rate": 0.9},
    ):  # fmt: skip
        assert not torch.equal(trained(**settings), usual), settings


def test_with_few_views_and_gas_refused_nothing_is_left_to_learn_from(scene):
    one = scene(views=6)
    found = wernet(one.projector, one.measured, refused=("absorption",))
    assert found.weights is None
    assert "all that so few views show of optics was refused" in found.stop_reason
    assert found.settings["refused"] == ["absorption"]


def test_active_voxels_alone_are_solved_for(shaded):
    active = ActiveVoxels.from_mask(shaded.grid, shaded.truth > 0.01)
    system = LinearSystem.from_rig(shaded.rig, shaded.grid, active=active, midpoints=True)
    found = wernet(system.projector, system.flatten(shaded.images), iterations=2)
    assert found.settings["learned"] is True
    assert not found.volume.ravel()[active.number < 0].any()
    assert found.weights.volume.shape == (active.size,)


@pytest.mark.parametrize("last", [0, 1, 2])
def test_the_callback_sees_every_outer_iteration_and_stops(scene, shaded, last):
    seen = []

    def callback(index, unknowns, residual):
        seen.append((index, unknowns, residual))
        return index >= last

    found = wernet(shaded.projector, shaded.measured, callback=callback)
    assert "stopped by the callback" in found.stop_reason
    # the iterations up to there, and the returned volume where that is another
    assert [entry[0] for entry in seen] == [entry.index for entry in found.history]
    assert [entry[2] for entry in seen] == [entry.relative_residual for entry in found.history]
    assert len(seen) - (last + 1) in (0, 1)
    np.testing.assert_array_equal(seen[-1][1], found.volume.ravel())
    if last == 0:
        assert_classic(found, classic(scene))
        assert len(seen) == 1


def test_no_outer_iteration_is_the_classic_solve(scene, shaded):
    assert_classic(wernet(shaded.projector, shaded.measured, iterations=0), classic(scene))


@pytest.mark.parametrize("power", [-100, 100])
def test_the_unit_of_the_images_is_that_of_the_volume(scene, shaded, power):
    """To the bit: powers of two change no digit, and squares stay in range; voxels may vanish."""
    plain = learned(scene)
    scaled = wernet(shaded.projector, np.ldexp(shaded.measured, power), iterations=2)
    assert scaled.stop_reason == plain.stop_reason
    least = 16 * np.finfo(np.float32).smallest_subnormal  # to which the faintest voxels round
    expected = np.ldexp(plain.volume, power)
    np.testing.assert_allclose(scaled.volume, expected, rtol=0, atol=least)


def test_an_encoder_in_memory_or_in_a_file_is_not_changed_by_training(shaded, tmp_path):
    path, encoder = tmp_path / "encoder.pt", Encoder(blocks=1, channels=8, silent=True, seed=4)
    save_encoder(encoder, path)
    content = path.read_bytes()
    before = {name: value.clone() for name, value in encoder.state_dict().items()}
    found, from_file, fresh = (
        wernet(shaded.projector, shaded.measured, seed=4, iterations=1, **given)
        for given in (
            {"encoder": encoder},
            {"encoder": path},
            {"settings": WernetSettings(blocks=1, channels=8)},
        )
    )
    assert all(torch.equal(before[name], value) for name, value in encoder.state_dict().items())
    assert path.read_bytes() == content
    assert found.settings["encoder"] == "in memory"
    assert from_file.settings["encoder"] == str(path)
    assert (found.settings["blocks"], found.settings["channels"]) == (1, 8)
    np.testing.assert_array_equal(found.volume, fresh.volume)
    np.testing.assert_array_equal(from_file.volume, fresh.volume)


@pytest.mark.parametrize("value", [1e4, 1e10, np.nan])
@pytest.mark.parametrize("freeze", [False, True], ids=["trained", "frozen"])
def test_an_encoder_that_explodes_leaves_the_classic_solve(scene, shaded, value, freeze):
    encoder = Encoder(blocks=1, channels=4)
    with torch.no_grad():
        for parameter in encoder.parameters():
            parameter.fill_(value)
    how = {"encoder": encoder, "freeze_encoder": freeze, "iterations": 1}
    found = wernet(shaded.projector, shaded.measured, **how)
    assert_classic(found, classic(scene))
    assert "diverged in " in found.stop_reason
    assert all(np.isfinite(entry.relative_residual) for entry in found.history)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"iterations": -1}, "iterations: found -1, expected a whole number >= 0"),
        ({"iterations": 1.5}, "iterations: found 1.5"),
        ({"freeze_encoder": True}, "freeze_encoder: found no encoder to freeze"),
        ({"device": "abacus"}, "device: found 'abacus'"),
        ({"encoder": Encoder("relative")}, "encoder: found one that sees 'relative' inputs"),
        ({"measured": np.ones(3)}, "measured: found"),
        ({"measured": np.full(3192, np.nan)}, r"measured.*NaN"),
    ],
)
def test_bad_arguments_are_named_in_one_line(scene, arguments, message):
    one = scene()
    with pytest.raises(ValueError, match=message) as caught:
        wernet(one.projector, **{"measured": one.measured, **arguments})
    assert "\n" not in str(caught.value)


def test_an_encoder_that_couples_rays_is_refused(scene):
    one = scene()
    encoder = Encoder("optics", variant="batch-norm")
    with pytest.raises(ValueError, match="encoder: found one with batch normalisation, expected"):
        wernet(one.projector, one.measured, encoder=encoder)
