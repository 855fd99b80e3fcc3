import numpy as np
import pytest
import torch

from tomo._compute.reductions import dot
from tomo.selection import Choice, choose_by_left_out_pixels
from tomo.simulation.effects import Effects
from tomo.wernet.default import RayFeatures, ViewParameters, wernet
from tomo.wernet.default.left_out import LeftOut
from tomo.wernet.default.linearisation import PixelSubset
from tomo.wernet.default.patches import Patches
from tomo.wernet.default.variable_projection import (
    GAINS,
    PRIOR,
    _gauss_newton,
    _promising,
    fit_parametric_terms,
)


def _found(one):
    choice = choose_by_left_out_pixels(one.projector, one.measured)
    unit = float(np.sqrt(np.mean(one.measured**2)))
    pixels, features = LeftOut.of(one.projector, one.measured), RayFeatures.of(one.projector)
    found = fit_parametric_terms(
        pixels,
        features,
        choice,
        unit,
        lambda: pixels.judge(one.projector, choice),
        {0, 1, 2, GAINS},
    )
    return found[0], unit


def _linearised(one, view_parameters, stride=1):
    unit = float(np.sqrt(np.mean(one.measured**2)))
    some = PixelSubset.of(one.projector, one.measured, stride, unit)
    return some.linearise(view_parameters, Choice(0.0, 1e-5, 40, 0.1))


def test_columns_are_the_change_of_the_residual_that_voxels_leave(scene):
    one, view_parameters = scene(), ViewParameters(12, 1)
    now, small = _linearised(one, view_parameters), 0.02
    moved = ViewParameters(12, 1)
    with torch.no_grad():
        moved.coefficients[0] -= small
    change = (_linearised(one, moved).residual - now.residual) / (small * now.scale(0))
    apart = np.linalg.norm(now.column(0) - change) / np.linalg.norm(change)
    assert apart < 0.2  # of which the step's size leaves a tenth
    moved = ViewParameters(12, 1)
    with torch.no_grad():
        moved.log_gain[3] -= small
    own = now.view == 3
    change = (_linearised(one, moved).residual - now.residual)[own] / small
    # voxels imitate about the part of a gain that one view of twelve has in them
    ratio = change @ now.gain_change[own] / (now.gain_change[own] @ now.gain_change[own])
    assert 0.6 < ratio < 1


@pytest.mark.parametrize(
    ("effects", "finer", "asked"),
    [
        (None, 2, set()),
        (Effects(gain_spread=0.1), 2, {GAINS}),
        (Effects(absorption=0.1), 2, {0}),
        (Effects(self_absorption=0.2), 1, {1}),
    ],
    ids=["segment_lengths", "gains", "even", "own"],
)
def test_candidates_are_the_terms_that_the_residuals_show(scene, effects, finer, asked):
    view_parameters = ViewParameters(12, 1)
    now = _linearised(scene(effects=effects, finer=finer), view_parameters)
    promising = {
        part for parts in _promising(now, view_parameters, (), {0, 1, 2, GAINS}) for part in parts
    }
    assert asked <= promising
    if not asked - {GAINS}:
        assert not promising - {GAINS}  # no term but where there is one


def test_the_gains_of_the_cameras_are_found(scene):
    effects = Effects(gain_spread=0.1)
    view_parameters, _ = _found(scene(effects=effects))
    found = np.exp(2 * view_parameters.log_gain.detach().numpy())
    true = effects.gains(12, 3)
    assert np.corrcoef(found, true)[0, 1] > 0.98
    assert np.std(found / true) < 0.3 * np.std(true)
    assert abs(float(view_parameters.log_gain.detach().mean())) < 1e-6
    assert view_parameters.coefficients.abs().max() < 0.02


def test_self_absorption_is_found(scene):
    strength = 0.2
    view_parameters, unit = _found(scene(effects=Effects(self_absorption=strength)))
    depth, upstream, _ = view_parameters.coefficients.tolist()
    # exp(-q I) = (1 + c)² with ln(1 + c) = -q I / 2
    assert upstream == pytest.approx(-strength * unit / 2, rel=0.4)
    assert abs(depth) < 0.02
    assert not view_parameters.log_gain.any()  # gains would predict nothing


def test_even_absorption_is_found(scene):
    strength, one = 0.1, scene(effects=Effects(absorption=0.1))
    view_parameters, _ = _found(one)
    depth, upstream, _ = view_parameters.coefficients.tolist()
    # exp(-k d) of what has d to go to the camera; the depth feature is 2 d / edge - 1
    assert depth == pytest.approx(-strength * one.grid.extent.min() / 4, rel=0.3)
    assert abs(upstream) < 0.02


def test_vignetting_is_found_where_pixels_are_fine(scene):
    lens = Effects(vignetting=0.4)
    one = scene(effects=lens, finer=2, image_size=(42, 60))
    view_parameters, _ = _found(one)
    depth, upstream, off_axis = view_parameters.coefficients.tolist()
    assert depth == upstream == 0
    assert not view_parameters.log_gain.any()
    # (1 + k r²)^-2 of the light is left, (1 + c)² with ln(1 + c) = -k r² near the axis
    camera, pixels = one.rig[0], one.system.pixels[0]
    width = camera.image_size[0]
    least = lens.falloff(camera, np.stack([pixels % width, pixels // width], 1)).min()
    assert -off_axis == pytest.approx(least**-0.5 - 1, rel=0.2)
    plain, _ = _found(scene(finer=2, image_size=(42, 60)))
    assert plain is None


def test_a_change_of_sign_from_pixel_to_pixel_cancels_within_a_patch(scene):
    one = scene(image_size=(42, 60))
    patches = Patches.of(one.projector, RayFeatures.of(one.projector))
    random = np.random.default_rng(0)
    noise = random.standard_normal((200, one.projector.shape[0]))
    summed = np.array([patches.sum(image) for image in noise])
    assert np.std(summed) == pytest.approx(1, rel=0.02)  # white noise keeps its size
    width = one.rig[0].image_size[0]
    pixels = np.concatenate(one.system.pixels)
    board = (-1.0) ** (pixels % width + pixels // width)
    even = patches.sum(np.ones(len(board)))
    assert np.linalg.norm(patches.sum(board)) < 0.05 * np.linalg.norm(even)
    one_view = np.flatnonzero(patches.view == 5)
    assert not patches.tents[one_view][:, : one.projector.view_ptr[5]].nnz


def test_noise_of_single_pixels_hides_no_term(scene):
    one = scene(effects=Effects(self_absorption=0.2), image_size=(42, 60))
    random = np.random.default_rng(5)
    noisy = one.measured + 0.02 * one.measured.max() * random.standard_normal(len(one.measured))
    found = wernet(one.projector, noisy.astype(np.float32), iterations=1)
    assert found.weights.view_parameters.coefficients[1].item() < -0.02


@pytest.mark.parametrize("finer", [1, 2])
def test_true_segment_lengths_leave_no_term_to_find(scene, finer):
    view_parameters, _ = _found(scene(finer=finer))
    assert view_parameters is None


def test_the_same_bits_again_and_the_global_state_is_left_alone(scene):
    one = scene(effects=Effects(gain_spread=0.1))
    state = torch.get_rng_state()
    (first, _), (second, _) = _found(one), _found(one)
    assert torch.equal(torch.get_rng_state(), state)
    for name, value in first.state_dict().items():
        assert torch.equal(value, second.state_dict()[name])


def test_one_step_solves_the_normal_equations_in_sums_that_no_thread_changes():
    random = np.random.default_rng(0)
    view = np.repeat(np.arange(3), 20_000)
    row, other, residual = random.standard_normal((3, len(view)))
    level = random.standard_normal(len(view))
    found = _gauss_newton([row, other], level, view, residual, 3)
    columns = np.zeros((len(view), 5))
    columns[:, 0], columns[:, 1] = row, other
    columns[np.arange(len(view)), 2 + view] = level
    ridge = np.mean(residual**2) / PRIOR**2
    normal, right = columns.T @ columns + ridge * np.eye(5), columns.T @ residual
    np.testing.assert_allclose(found, np.linalg.solve(normal, right), rtol=1e-9)
    # to the bit it is that of sums in a fixed order, which BLAS in several threads are not
    for i, one in enumerate((row, other)):
        right[i] = dot(one, residual)
        normal[i, 2:] = normal[2:, i] = np.bincount(view, level * one, 3)
        for j, two in enumerate((row, other)):
            normal[i, j] = dot(one, two) + (ridge if i == j else 0)
    power = np.bincount(view, level**2, 3)
    normal[2:, 2:] = np.diag(power + ridge)
    right[2:] = np.bincount(view, level * residual, 3)
    np.testing.assert_array_equal(found, np.linalg.solve(normal, right))


@pytest.mark.parametrize("factor", [2.0**-80, 2.0**80])
def test_a_step_knows_no_smallest_intensity(factor):
    random = np.random.default_rng(4)
    row, level, residual = random.random((3, 60))
    view = np.repeat(np.arange(5), 12)
    step = _gauss_newton([row], level, view, 1e-3 * residual, 5)
    scaled = _gauss_newton([factor * row], factor * level, view, factor * 1e-3 * residual, 5)
    np.testing.assert_array_equal(scaled, step)


def test_dark_views_keep_their_gains():
    view, dark = np.repeat(np.arange(3), 4), np.zeros(12)
    assert not _gauss_newton([dark], dark, view, dark, 3).any()
    level = np.where(view == 1, 0.0, 1.0)
    step = _gauss_newton([dark], level, view, 0.1 * level, 3)
    assert step[2] == 0
    ridge = np.mean((0.1 * level) ** 2) / PRIOR**2
    np.testing.assert_allclose(step[[1, 3]], 0.4 / (4 + ridge))
