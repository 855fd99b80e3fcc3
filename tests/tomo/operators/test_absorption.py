"""Gas that absorbs: closed forms, one answer by every form of the matrix, and its bounds."""

import numpy as np
import pytest

import rigs
from tomo.grid import ActiveVoxels, VoxelGrid
from tomo.operators import Absorption, LinearSystem
from tomo.trace import TRACERS

GRID = VoxelGrid((9, 8, 10), (1.0, 1.2, 0.9), (3.0, -2.0, 1.0))
RIG = rigs.ring(
    3, distance=400.0, image_size=(26, 24), footprint=0.55, center=GRID.center,
    pitch_degrees=[20.0, -35.0, 5.0], start_degrees=17.0,
)  # fmt: skip
EMISSION = np.random.default_rng(0).random(GRID.shape).astype(np.float32)
SOME = ActiveVoxels.from_mask(GRID, np.random.default_rng(1).random(GRID.shape) < 0.6)
GAS = Absorption(0.07, 0.15)


def system(**how):
    return LinearSystem.from_rig(RIG, GRID, skip=False, **how)


def test_an_even_medium_dims_by_the_way_to_the_camera():
    plain = system(form="stored")
    k = 0.11
    seen = plain.with_absorption(Absorption(medium=k)).projector.row_sums
    # steps of one voxel: the midpoint of each stands for its exponential to second order
    expected = -np.expm1(-k * plain.projector.row_sums) / k
    np.testing.assert_allclose(seen, expected, rtol=2e-3)


@pytest.mark.parametrize("supersample", [1, 2])
@pytest.mark.parametrize("active", [ActiveVoxels(GRID), SOME], ids=["all", "some"])
def test_on_the_fly_gives_what_is_stored(active, supersample):
    how = {"active": active, "supersample": supersample}
    x = active.compress(EMISSION)
    stored, fly = (
        system(form=form, **how).with_absorption(GAS, EMISSION, supersample=supersample)
        for form in ("stored", "on-the-fly")
    )
    np.testing.assert_allclose(fly.projector @ x, stored.projector @ x, rtol=1e-5, atol=1e-6)
    some = np.arange(3, 1000, 7)
    part = fly.projector.take(some) @ x
    np.testing.assert_allclose(part, (stored.projector @ x)[some], rtol=1e-5, atol=1e-6)
    assert fly.projector.subset([2]).shape[0] == stored.projector.subset([2]).shape[0]


@pytest.mark.parametrize("tracer", TRACERS)
def test_every_tracer_gives_the_same_dimming(tracer):
    found = system(form="stored", tracer=tracer).with_absorption(GAS, EMISSION, tracer=tracer)
    march = system(form="stored").with_absorption(GAS, EMISSION)
    np.testing.assert_allclose(
        found.projector.row_sums, march.projector.row_sums, rtol=1e-4, atol=1e-4
    )


@pytest.mark.parametrize("form", ["stored", "on-the-fly"])
def test_other_gas_takes_the_place_of_the_first(form):
    plain = system(form=form)
    twice = plain.with_absorption(Absorption(0.5)).with_absorption(GAS, EMISSION)
    once = plain.with_absorption(GAS, EMISSION)
    x = EMISSION.ravel()
    np.testing.assert_array_equal(twice.projector @ x, once.projector @ x)
    clear = twice.with_absorption(Absorption())
    np.testing.assert_allclose(clear.projector @ x, plain.projector @ x, rtol=1e-6)


def test_segments_are_dimmed_under_the_blur_of_the_linear_basis():
    linear = system(form="stored").with_linear_basis().with_absorption(GAS, EMISSION).projector
    rays = system(form="stored").with_absorption(GAS, EMISSION).projector
    x = EMISSION.ravel()
    np.testing.assert_array_equal(linear @ x, linear.projector.images @ (rays @ x))


@pytest.mark.parametrize("wrong", [-0.1, np.nan, np.inf])
def test_strengths_are_checked(wrong):
    with pytest.raises(ValueError, match="absorption medium: found"):
        Absorption(medium=wrong)
    with pytest.raises(ValueError, match="absorption emission: found"):
        Absorption(emission=wrong)
    assert not Absorption()
    assert Absorption(emission=0.1)
