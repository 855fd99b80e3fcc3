"""The dot test of every operator, of all its pixels and of some, on all voxels and on some."""

import numpy as np
import pytest

import rigs
from tomo.grid import ActiveVoxels, VoxelGrid
from tomo.operators import (
    Absorption,
    GaussianBasis,
    LinearSystem,
    dot_test,
    footprint_blur,
    lens_blur,
)
from tomo.operators.composition import ImageOperator
from tomo.priors import Gradient, RelativeCurvature

GRID = VoxelGrid((9, 8, 10), (1.0, 1.2, 0.9), (3.0, -2.0, 1.0))
RIG = rigs.ring(
    3, distance=400.0, image_size=(26, 24), footprint=0.55, center=GRID.center,
    pitch_degrees=[20.0, -35.0, 5.0], start_degrees=17.0,
)  # fmt: skip
SOME = ActiveVoxels.from_mask(GRID, np.random.default_rng(0).random(GRID.shape) < 0.4)


def reweighted(system):
    random = np.random.default_rng(1)
    segments = system.projector.segments
    length = segments.length * random.normal(1, 2, len(segments)).astype(np.float32)
    return system.projector.with_lengths(length)


def absorbing(system):
    """Return the system with gas that absorbs evenly, and by its own emission too."""
    emission = np.random.default_rng(2).random(GRID.shape).astype(np.float32)
    return system.with_absorption(Absorption(0.05, 0.1), emission)


def compositions(system, form):
    """Return every operator on one form of the matrix, by name."""
    rays, lens, linear = (
        system.projector,
        system.with_lens_blur(2.5).projector,
        system.with_linear_basis().projector,
    )
    found = {
        "rays": rays,
        "lens": lens,
        "linear": linear,
        "voxel means": linear.on_voxel_means,
        "Gaussian": GaussianBasis(rays, 0.8),
        "Gaussian through a lens": GaussianBasis(lens, 0.8),
        "absorbing gas": absorbing(system).projector,
        "linear absorbing gas": absorbing(system.with_linear_basis()).projector,
    }
    if form == "stored":
        found |= {
            "other lengths": reweighted(system),
            "lens of other lengths": lens.with_lengths(reweighted(system).segments.length),
        }
    return {f"{form} {name}": operator for name, operator in found.items()}


@pytest.fixture(scope="module")
def operators():
    """Return every projection operator by name and by whether all voxels are active."""
    found = {}
    for active in (ActiveVoxels(GRID), SOME):
        for form in ("stored", "on-the-fly"):
            system = LinearSystem.from_rig(RIG, GRID, active=active, skip=False, form=form)
            for name, operator in compositions(system, form).items():
                found[name, active.all] = operator
    return found


NAMES = [
    f"{form} {name}"
    for form in ("stored", "on-the-fly")
    for name in (
        "rays",
        "lens",
        "linear",
        "voxel means",
        "Gaussian",
        "Gaussian through a lens",
        "absorbing gas",
        "linear absorbing gas",
    )
] + ["stored other lengths", "stored lens of other lengths"]
PRECISIONS = pytest.mark.parametrize(("dtype", "bound"), [(np.float64, 1e-12), (np.float32, 1e-6)])


@PRECISIONS
@pytest.mark.parametrize("every_voxel", [True, False])
@pytest.mark.parametrize("name", NAMES)
def test_projections(operators, name, every_voxel, dtype, bound):
    operator = operators[name, every_voxel]
    parts = (
        operator,
        operator.view(1),
        operator.subset([2, 0]),
        operator.take(np.arange(0, operator.shape[0], 3)),
        operator.subset([1, 2]).take(np.arange(5, 600, 7)).packed(),
    )
    for part in parts:
        assert max(dot_test(part, seed, dtype) for seed in range(3)) < bound


def test_every_operator_is_here(operators):
    assert {name for name, _ in operators} == set(NAMES)


@PRECISIONS
@pytest.mark.parametrize("kind", ["lens", "footprint"])
def test_image_blurs(kind, dtype, bound):
    pixels = [np.arange(0, 26 * 24, 1 + view) for view in range(3)]
    seen = np.random.default_rng(2).random(sum(map(len, pixels))) < 0.9
    blur = (
        lens_blur(RIG, pixels, GRID, 2.5)
        if kind == "lens"
        else footprint_blur(RIG, pixels, seen, GRID)
    )
    assert isinstance(blur, ImageOperator)
    part, needed = blur.take(np.arange(7, 900, 4))
    assert part.shape == (len(np.arange(7, 900, 4)), len(needed))
    for operator in (blur, part):
        assert max(dot_test(operator, seed, dtype) for seed in range(3)) < bound


@pytest.mark.parametrize("active", [ActiveVoxels(GRID), SOME], ids=["all", "some"])
@pytest.mark.parametrize("kind", ["differences", "curvature"])
def test_linear_priors(kind, active):
    random = np.random.default_rng(3)
    volume = random.standard_normal(active.size).astype(np.float32)
    prior = Gradient(active) if kind == "differences" else RelativeCurvature(active, volume)
    for _ in range(3):
        x = random.standard_normal(active.size).astype(np.float32)
        forward = prior.forward(x).astype(np.float64).ravel()
        y = random.standard_normal(forward.size).astype(np.float32)
        adjoint = prior.adjoint(y).astype(np.float64)
        error = abs(forward @ y - x @ adjoint)
        assert error < 1e-6 * np.linalg.norm(forward) * np.linalg.norm(y)
