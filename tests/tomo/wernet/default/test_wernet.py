from functools import lru_cache

import numpy as np
import pytest
import torch

from tomo import LinearSystem
from tomo.grid import ActiveVoxels
from tomo.metrics import cosine_distance
from tomo.operators import Projector
from tomo.selection import choose_by_left_out_pixels, solve_as_chosen
from tomo.simulation.effects import Effects
from tomo.trace import Segments
from tomo.wernet.default import RayWeights, wernet
from tomo.wernet.default.ray_features import FEATURES
from tomo.wernet.default.wernet import FEW_VIEW_FEATURES

pytestmark = pytest.mark.usefixtures("quick_choices")

GAINS = Effects(gain_spread=0.1)
ABSORPTION = Effects(absorption=0.1)
OWN_LIGHT = Effects(self_absorption=0.2)


@lru_cache
def _shared(make, effects, iterations=8):
    one = make(effects=effects)
    return wernet(one.projector, one.measured, iterations=iterations)


def _classic(one):
    """Return the classic solve of a scene, which keeps it for the next test."""
    if not hasattr(one, "classic"):
        choice = choose_by_left_out_pixels(one.projector, one.measured)
        one.classic = solve_as_chosen(one.projector, one.measured, choice)
    return one.classic


def _assert_classic(found, one):
    """Check that a result is the classic solve to the bit, and that it is reported."""
    classic = _classic(one)
    np.testing.assert_array_equal(found.volume, classic.volume)
    assert found.weights is None
    assert found.settings["method"] == "wernet"
    assert found.settings["learned"] is False
    assert "segment lengths are kept" in found.stop_reason


@pytest.mark.parametrize("effects", [GAINS, ABSORPTION, OWN_LIGHT], ids=["gains", "even", "own"])
def test_effects_beyond_segment_lengths_are_learned(scene, effects):
    one = scene(effects=effects)
    found, classic = _shared(scene, effects), _classic(one)
    assert found.settings["learned"] is True
    assert isinstance(found.weights, RayWeights)
    evaluated = found.settings["held_out_residual"]
    assert evaluated["learned"] < 0.7 * evaluated["segment_lengths"]
    assert found.relative_residual < 0.7 * classic.relative_residual
    apart = cosine_distance(found.volume, one.truth)
    assert apart < 0.3 * cosine_distance(classic.volume, one.truth)
    assert found.volume.dtype == np.float32
    assert found.volume.min() >= 0


def test_volume_and_weights_of_a_solution_belong_together(scene):
    one, found = scene(effects=GAINS), _shared(scene, GAINS)
    learned = found.weights.projector(one.projector)
    misfit = learned @ one.projector.active.compress(found.volume) - one.measured
    residual = np.linalg.norm(misfit) / np.linalg.norm(one.measured)
    assert residual == pytest.approx(found.relative_residual, rel=1e-3)
    plain = one.projector @ one.projector.active.compress(found.volume) - one.measured
    assert np.linalg.norm(misfit) < 0.5 * np.linalg.norm(plain)


def test_the_cameras_gains_are_found(scene):
    one, found = scene(effects=GAINS), _shared(scene, GAINS)
    learned = found.weights.projector(one.projector)
    volume = one.truth.ravel()
    true = GAINS.gains(len(one.rig), 3)
    mean = [
        (learned.view(view) @ volume).sum() / (one.projector.view(view) @ volume).sum()
        for view in range(len(one.rig))
    ]
    assert np.corrcoef(mean, true)[0, 1] > 0.95
    assert np.std(np.divide(mean, true)) < 0.5 * np.std(true)


def test_the_scale_of_the_volume_is_kept(scene):
    one, found = scene(effects=GAINS), _shared(scene, GAINS)
    assert found.volume.sum() == pytest.approx(one.truth.sum(), rel=0.05)


def test_true_segment_lengths_are_kept_to_the_bit(scene):
    one, found = scene(), _shared(scene, None)
    _assert_classic(found, one)
    evaluated = found.settings["held_out_residual"]
    assert not evaluated["learned"] < 0.98 * evaluated["segment_lengths"]


@pytest.mark.parametrize("views", [12, 16])
def test_voxels_and_pixels_of_some_size_are_no_reason_to_learn_what_is_wrong(scene, views):
    one = scene(views=views, finer=2)
    found = wernet(one.projector, one.measured)
    apart = cosine_distance(found.volume, one.truth)
    assert apart < 1.05 * cosine_distance(_classic(one).volume, one.truth)


def test_the_same_bits_again_and_for_any_number_of_threads(scene, on_threads):
    one = scene(effects=GAINS)
    found = [_shared(scene, GAINS, iterations=2)]  # on one thread
    with on_threads(4):
        found.append(wernet(one.projector, one.measured, iterations=2))
        assert torch.get_num_threads() == 4
    assert found[0].weights is not None
    lengths = [each.weights.projector(one.projector).segments.length for each in found]
    for each, length in zip(found[1:], lengths[1:], strict=True):
        np.testing.assert_array_equal(each.volume, found[0].volume)
        np.testing.assert_array_equal(length, lengths[0])
        assert each.settings == found[0].settings
        for entry, first in zip(each.history, found[0].history, strict=True):  # training too
            assert entry.relative_residual == first.relative_residual


def test_the_seed_decides_and_the_global_state_is_left_alone(scene):
    one = scene(effects=GAINS)
    state, drawn = torch.get_rng_state(), np.random.get_state()[1].copy()  # noqa: NPY002
    other = wernet(one.projector, one.measured, iterations=2, seed=2)
    assert torch.equal(torch.get_rng_state(), state)
    assert np.array_equal(np.random.get_state()[1], drawn)  # noqa: NPY002
    first = _shared(scene, GAINS, iterations=2)
    residuals = [[entry.relative_residual for entry in each.history] for each in (first, other)]
    assert residuals[0][:2] == residuals[1][:2]  # the classic solve and that with terms
    assert residuals[0][2] != residuals[1][2]


@pytest.mark.parametrize("views", [1, 2])
def test_with_too_few_views_segment_lengths_are_kept(scene, views):
    one = scene(views=views, image_size=(7, 10))
    found = wernet(one.projector, one.measured)
    _assert_classic(found, one)
    assert "too few views" in found.stop_reason


def test_views_that_see_nothing_do_not_count(scene):
    one = scene(views=3, effects=GAINS)
    masks = [np.ones((20, 14), bool), np.ones((20, 14), bool), np.zeros((20, 14), bool)]
    system = LinearSystem.from_rig(one.rig, one.grid, masks=masks, midpoints=True)
    measured = system.flatten(list(one.scan.images.values()))
    found = wernet(system.projector, measured)
    assert found.weights is None
    assert "too few views" in found.stop_reason


def test_dark_images_give_an_empty_volume(scene):
    one = scene()
    found = wernet(one.projector, np.zeros_like(one.measured))
    assert not found.volume.any()
    assert found.weights is None
    assert "the images are dark" in found.stop_reason


def test_rays_that_all_miss_the_grid_are_refused(scene):
    one = scene()
    s = one.projector.segments
    nothing = Segments(np.zeros_like(s.ptr), s.voxel[:0], s.length[:0], s.midpoint[:0])
    blind = Projector(nothing, one.grid, one.projector.view_ptr)
    with pytest.raises(ValueError, match="segments: found none, expected at least one ray"):
        wernet(blind, one.measured)


def test_few_views_have_no_parameters_of_their_own(scene):
    one = scene(views=6, effects=ABSORPTION)
    weights = wernet(one.projector, one.measured, iterations=2).weights
    assert not weights.per_view
    assert not weights.view_parameters.log_gain.any()
    seen = weights.encoder.hidden[0].weight.abs().amax(dim=(0, 2)) > 0
    assert {name for name, some in zip(FEATURES, seen, strict=True) if some} == set(
        FEW_VIEW_FEATURES
    )
    many = _shared(scene, OWN_LIGHT).weights
    assert many.per_view
    assert many.encoder.hidden[0].weight.abs().amax(dim=(0, 2)).all()


def test_active_voxels_alone_are_solved_for(scene):
    one = scene(effects=GAINS)
    active = ActiveVoxels.from_mask(one.grid, one.truth > 0.01)
    system = LinearSystem.from_rig(one.rig, one.grid, active=active, midpoints=True)
    measured = system.flatten(list(one.scan.images.values()))
    found = wernet(system.projector, measured, iterations=4)
    assert found.settings["learned"] is True
    assert not found.volume.ravel()[active.number < 0].any()
    assert cosine_distance(found.volume, one.truth) < 0.002
    assert found.weights.volume.shape == (active.size,)


@pytest.mark.parametrize("last", [0, 1, 2])
def test_the_callback_sees_every_outer_iteration_and_stops(scene, last):
    one, seen = scene(effects=GAINS), []

    def callback(index, volume, residual):
        seen.append((index, volume, residual))
        return index >= last

    found = wernet(one.projector, one.measured, callback=callback)
    assert "stopped by the callback" in found.stop_reason
    # the iterations up to there, and the returned volume where that is another
    assert [entry[0] for entry in seen] == [entry.index for entry in found.history]
    assert [entry[2] for entry in seen] == [entry.relative_residual for entry in found.history]
    assert len(seen) - (last + 1) in (0, 1)
    np.testing.assert_array_equal(seen[-1][1], found.volume.ravel())
    if last == 0:
        _assert_classic(found, one)
        assert len(seen) == 1


def test_the_history_is_that_of_the_volume_returned(scene):
    for effects in (GAINS, None):
        found = _shared(scene, effects)
        assert len(found.history) > 1
        seconds = [entry.seconds for entry in found.history]
        assert [entry.index for entry in found.history] == list(range(len(found.history)))
        assert seconds == sorted(seconds)
        one = scene(effects=effects)
        operator = found.weights.projector(one.projector) if found.weights else one.projector
        misfit = operator @ found.volume.ravel() - one.measured
        residual = np.linalg.norm(misfit) / np.linalg.norm(one.measured)
        assert found.relative_residual == pytest.approx(residual, rel=1e-3)


def test_no_outer_iteration_is_the_classic_solve(scene):
    one = scene(effects=GAINS)
    found = wernet(one.projector, one.measured, iterations=0)
    np.testing.assert_array_equal(found.volume, _classic(one).volume)
    assert found.weights is None


def test_a_start_is_where_the_first_outer_iteration_begins(scene):
    one = scene(effects=GAINS)
    start = np.where(one.truth > 0, 0.5 + one.truth, 0.0).astype(np.float32)
    before = start.copy()
    whole, flat = (
        wernet(one.projector, one.measured, iterations=1, start=given)
        for given in (start, start.ravel())
    )
    np.testing.assert_array_equal(start, before)
    np.testing.assert_array_equal(whole.volume, flat.volume)
    assert whole.settings["start"] is True
    without = _shared(scene, GAINS, iterations=1)
    first, second = (found.history[2].relative_residual for found in (without, whole))
    assert first != second


@pytest.mark.parametrize("power", [-100, 100])
def test_the_unit_of_the_images_is_that_of_the_volume(scene, power):
    """To the bit: powers of two change no digit, and squares stay in range; voxels may vanish."""
    one = scene(effects=GAINS)
    plain = _shared(scene, GAINS, iterations=2)
    scaled = wernet(one.projector, np.ldexp(one.measured, power), iterations=2)
    assert scaled.stop_reason == plain.stop_reason
    least = 16 * np.finfo(np.float32).smallest_subnormal  # to which the faintest voxels round
    expected = np.ldexp(plain.volume, power)
    np.testing.assert_allclose(scaled.volume, expected, rtol=0, atol=least)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"iterations": -1}, "iterations: found -1, expected a whole number >= 0"),
        ({"iterations": 1.5}, "iterations: found 1.5"),
        ({"freeze_encoder": True}, "freeze_encoder: found no encoder to freeze"),
        ({"device": "abacus"}, "device: found 'abacus'"),
        ({"blocks": 0}, "blocks: found 0"),
        ({"channels": 0}, "channels: found 0"),
        ({"measured": np.ones(3)}, "measured: found"),
        ({"start": np.ones(7)}, r"start: found shape \(7,\), expected a finite volume"),
        ({"start": np.full(1600, np.nan)}, r"start: found shape \(1600,\), expected a finite"),
    ],
)
def test_bad_arguments_are_named_in_one_line(scene, arguments, message):
    one = scene()
    with pytest.raises(ValueError, match=message) as caught:
        wernet(one.projector, **{"measured": one.measured, **arguments})
    assert "\n" not in str(caught.value)


def test_images_that_are_not_finite_are_refused(scene):
    one = scene()
    measured = one.measured.copy()
    measured[7] = np.nan
    with pytest.raises(ValueError, match=r"measured.*NaN"):
        wernet(one.projector, measured)


def test_segments_without_midpoints_are_refused(scene):
    one = scene()
    s = one.projector.segments
    plain = Projector(Segments(s.ptr, s.voxel, s.length), one.grid, one.projector.view_ptr)
    with pytest.raises(ValueError, match="trace with midpoints=True"):
        wernet(plain, one.measured)
