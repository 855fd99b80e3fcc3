"""Causes compete on pixels left out: the true one is taken, none where nothing is wrong."""

import numpy as np
import pytest

import rigs
from tomo.grid import VoxelGrid
from tomo.measurement import NoiseModel
from tomo.operators import Absorption, LinearSystem
from tomo.operators.view_gains import Gains
from tomo.pipeline.evidence import quick_solve, sample_of
from tomo.pipeline.options import Options
from tomo.screening.causes import AbsorbingGas, CameraGains
from tomo.screening.hypotheses import Evidence, Fitted, Model, explain
from tomo.screening.left_out_blocks import SIDE, Blocks, blocks_of

GRID = VoxelGrid((18, 22, 18), 1.0, (2.0, -1.0, 0.5))
RIG = rigs.ring(
    10, distance=400.0, image_size=(44, 52), footprint=0.55, center=GRID.center,
    pitch_degrees=12.0, start_degrees=17.0,
)  # fmt: skip
CAUSES = (
    CameraGains("gain"), AbsorbingGas("medium", False), AbsorbingGas("self-absorption", True)
)  # fmt: skip
GAIN = np.array([1.1, 0.92, 1.05, 1.0, 0.9, 1.08, 0.97, 1.0, 1.06, 0.94])


@pytest.fixture(scope="module")
def system():
    return LinearSystem.from_rig(RIG, GRID, skip=False)


@pytest.fixture(scope="module")
def truth():
    x, y, z = np.meshgrid(*(np.arange(n) - (n - 1) / 2 for n in GRID.shape), indexing="ij")
    left = np.exp(-((x + 3) ** 2 + y**2 / 6 + z**2) / 6)
    right = 0.7 * np.exp(-((x - 2.5) ** 2 + (y - 2) ** 2 / 4 + (z - 2) ** 2) / 5)
    return (left + right).astype(np.float32)


def explained(system, images, asked=()):
    noise = [NoiseModel(0.01 * float(images.max()))] * len(RIG)
    random = np.random.default_rng(0)
    measured = images + random.normal(0, noise[0].read, len(images))
    sample = sample_of(system, measured.astype(np.float32), noise, Options())
    return explain(Model(sample.system), CAUSES, sample.evidence, asked)


def brightest(system, truth):
    return float((system.projector @ truth.ravel()).max())


def test_nothing_is_wrong_with_faultless_images(system, truth):
    found = explained(system, system.projector @ truth.ravel())
    assert found.best is found.as_given
    assert found.best.model.causes == ()


def test_images_as_given_are_solved_until_more_iterations_explain_no_more():
    grid = VoxelGrid((20, 8, 20), 1.0)  # a one-sided hollow flame, seen along voxel faces
    rig = rigs.ring(8, 22.5, distance=5000.0, image_size=(40, 20), footprint=0.5)
    fine = grid.refined(2)
    x, _, z = np.moveaxis(fine.centers(), -1, 0)
    flame = np.exp(-(((np.hypot(x, z) - 5) / 2) ** 2)) * (1 - 0.7 * np.tanh(z / 2))
    images = LinearSystem.from_rig(rig, fine, skip=False).projector @ flame.ravel()
    noise = [NoiseModel(0.01 * float(images.max()))] * 8
    system = LinearSystem.from_rig(rig, grid, skip=False)
    sample = sample_of(system, images.astype(np.float32), noise, Options())
    evidence, model = sample.evidence, Model(sample.system)
    given = explain(model, (), evidence).as_given
    assert given.error < 0.8 * evidence.fit(model).error
    assert evidence.fit(model, given.volume).error > 0.98 * given.error


def test_little_in_every_patch_is_sure_and_much_in_one_is_not(system):
    none, model = np.zeros(system.projector.shape[0]), Model(system)
    evidence = Evidence(none, Blocks.of(system), none, quick_solve)
    left = np.random.default_rng(0).uniform(0, 10, 60)  # what neither model explains
    all_alike, one = left + 0.1, left + 6.0 * (np.arange(60) == 0)
    worth = [
        evidence.worth(*(Fitted(model, none, errors) for errors in (before, left)))
        for before in (all_alike, one)
    ]
    assert worth == pytest.approx([left.sum() / all_alike.sum(), 1.0])


@pytest.mark.parametrize("depth", [0.4, 1.0])
def test_gas_that_absorbs_its_own_light_is_found_with_its_coefficient(system, truth, depth):
    q = depth / brightest(system, truth)
    gas = system.with_absorption(Absorption(emission=q), truth)
    found = explained(system, gas.projector @ truth.ravel())
    assert found.best.model.causes == ("self-absorption",)
    assert found.best.model.absorption.emission == pytest.approx(q, rel=0.2)
    assert found.best.model.absorption.medium == 0


def test_a_medium_is_found_with_its_coefficient(system, truth):
    k = 0.6 / float(np.mean(GRID.extent))
    gas = system.with_absorption(Absorption(medium=k))
    found = explained(system, gas.projector @ truth.ravel())
    assert found.best.model.causes == ("medium",)
    assert found.best.model.absorption.medium == pytest.approx(k, rel=0.1)


def test_gains_are_found_where_cameras_differ(system, truth):
    none = Gains.none(len(RIG))
    wrong = Gains(GAIN, none.offset, none.gain_error, none.offset_error)
    found = explained(system, wrong.apply(system.projector, system.projector @ truth.ravel()))
    assert found.best.model.causes == ("gain",)
    relative = found.best.model.gains.gain / GAIN
    np.testing.assert_allclose(relative / relative.mean(), 1, atol=0.02)


def test_gains_and_absorption_add_up(system, truth):
    gas = system.with_absorption(Absorption(emission=1 / brightest(system, truth)), truth)
    none = Gains.none(len(RIG))
    wrong = Gains(GAIN, none.offset, none.gain_error, none.offset_error)
    found = explained(system, wrong.apply(gas.projector, gas.projector @ truth.ravel()))
    assert set(found.best.model.causes) == {"gain", "self-absorption"}
    tried = {frozenset(one.causes) for one in found.trials}
    assert {frozenset({"gain"}), frozenset({"self-absorption"})} <= tried  # all were heard first


def test_blocks_left_out_are_squares_of_pixels_evenly_spread(system):
    blocks = Blocks.of(system)
    both = np.sort(np.concatenate([blocks.training, blocks.left_out]))
    np.testing.assert_array_equal(both, np.arange(system.projector.shape[0]))
    numbers = blocks_of(system)
    assert not set(numbers[blocks.training]) & set(numbers[blocks.left_out])
    assert np.bincount(blocks.block).max() == SIDE**2
    in_views = np.bincount(np.searchsorted(system.projector.view_ptr, blocks.left_out, "right"))
    assert in_views[1:].min() > 0.5 * in_views[1:].mean()


def test_the_noise_of_blocks_is_what_noise_makes(system):
    blocks = Blocks.of(system)
    random = np.random.default_rng(1)
    variance = random.uniform(0.5, 2, system.projector.shape[0])
    drawn = [
        blocks.squared_errors(random.normal(0, np.sqrt(variance[blocks.left_out]))).sum()
        for _ in range(60)
    ]
    assert np.mean(drawn) == pytest.approx(blocks.noise(variance), rel=0.03)


def test_a_quick_solve_reproduces_its_pixels(system, truth):
    measured = (system.projector @ truth.ravel()).astype(np.float32)
    found = quick_solve(system.projector, measured)
    left = np.linalg.norm(system.projector @ found - measured)
    assert left < 0.03 * np.linalg.norm(measured)
