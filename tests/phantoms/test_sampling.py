import tracemalloc

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.special import erf

import phantoms
from phantoms import GaussianBlobs, SampledField, sample
from tomo.grid import VoxelGrid


def exact_means(blobs, grid):
    """Return the voxel means of Gaussian blobs in closed form: products of 1-D integrals."""
    total = np.zeros(grid.shape)
    for center, width, amplitude in zip(
        blobs.centers, blobs.widths, blobs.amplitudes, strict=True
    ):
        factors = []
        for axis in range(3):
            edges = grid.lower[axis] + grid.spacing[axis] * np.arange(grid.shape[axis] + 1)
            steps = np.diff(erf((edges - center[axis]) / (np.sqrt(2) * width)))
            factors.append(width * np.sqrt(np.pi / 2) * steps / grid.spacing[axis])
        total += amplitude * np.einsum("i,j,k->ijk", *factors)
    return total


def test_means_of_blobs_converge_at_second_order_to_the_exact_ones():
    blobs = GaussianBlobs([[0.1, -0.2, 0.3], [1, 1, -1]], [0.8, 0.6], [1, 2])
    grid = VoxelGrid((8, 9, 7), (0.9, 0.7, 0.8))
    truth = exact_means(blobs, grid)
    errors = [np.abs(sample(blobs, grid, refine) - truth).max() for refine in (1, 2, 4, 8)]
    orders = np.log2(np.divide(errors[:-1], errors[1:]))
    np.testing.assert_allclose(orders, 2, atol=0.25)


@pytest.mark.parametrize("name", ["jet", "turbulent"])
def test_means_of_flames_converge_at_second_order(name):
    field, grid = phantoms.create(name), VoxelGrid((8, 10, 8), 0.5, (0.6, 1.0, 0.4))
    truth = sample(field, grid, 16)
    errors = [np.linalg.norm(sample(field, grid, refine) - truth) for refine in (1, 2, 4)]
    orders = np.log2(np.divide(errors[:-1], errors[1:]))
    np.testing.assert_allclose(orders, 2, atol=0.35)


@given(
    shape=st.tuples(*[st.integers(1, 9)] * 3),
    refine=st.integers(1, 3),
    at_once=st.integers(1, 300),
)
@settings(max_examples=20)
def test_blocks_do_not_change_the_means(shape, refine, at_once):
    grid = VoxelGrid(shape, (0.5, 0.75, 1.0), (0.1, 0.2, 0.3))

    def field(points):
        return np.sin(points @ [1.0, 2.0, 3.0]) + points[:, 1]

    expected = grid.average(
        field(grid.refined(refine).centers().reshape(-1, 3)).reshape(grid.refined(refine).shape),
        refine,
    )
    import phantoms.sampling as module

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(module, "_POINTS_AT_ONCE", at_once)
        found = sample(field, grid, refine)
    assert found.dtype == np.float32
    np.testing.assert_allclose(found, expected, atol=1e-6)


def test_memory_stays_bounded():
    """64 x 128 x 64 x 2³ points would take 100 MB as coordinates at once."""
    grid = VoxelGrid((64, 128, 64), 0.1)
    tracemalloc.start()
    try:
        sample(lambda points: np.ones(len(points)), grid, 2)
        peak = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    assert peak < 60e6


@pytest.mark.parametrize(
    ("field", "words"),
    [
        (lambda points: np.ones(3), "found values of shape"),
        (lambda points: points, "found values of shape"),
        (lambda points: np.full(len(points), np.nan), "NaN"),
    ],
)
def test_bad_fields(field, words):
    with pytest.raises(ValueError, match=words):
        sample(field, VoxelGrid((4, 4, 4), 1.0))


@pytest.mark.parametrize("refine", [0, -1, 1.5])
def test_bad_refinement(refine):
    with pytest.raises(ValueError, match="refinement: found"):
        sample(phantoms.create("jet"), VoxelGrid((4, 4, 4), 1.0), refine)


def test_a_sampled_field_sampled_on_its_own_grid_is_the_volume():
    grid = VoxelGrid((3, 4, 5), (0.5, 1, 0.1), (7, -3, 100))
    volume = np.random.default_rng(0).random(grid.shape).astype(np.float32)
    field = SampledField(volume, grid)
    for refine in (1, 3):
        np.testing.assert_allclose(sample(field, grid, refine), volume, rtol=1e-6)
    assert (field([[7, -3, 200], [0, -3, 100]]) == 0).all()
    assert field(grid.upper) == volume[-1, -1, -1]


def test_a_sampled_field_keeps_the_total_on_other_grids_that_share_its_planes():
    grid = VoxelGrid((4, 6, 4), 1.0)
    volume = np.random.default_rng(1).random(grid.shape)
    wider = VoxelGrid((4, 6, 4), 2.0)
    coarse = sample(SampledField(volume, grid), wider, 2)
    assert coarse.sum() * 8 == pytest.approx(volume.sum(), rel=1e-6)


def test_a_sampled_field_cannot_be_changed_and_leaves_its_source_writeable():
    volume = np.zeros((2, 2, 2))
    field = SampledField(volume, VoxelGrid((2, 2, 2), 1.0))
    with pytest.raises(ValueError, match="read-only"):
        field.volume[0, 0, 0] = 1
    volume[0, 0, 0] = 1


@pytest.mark.parametrize(
    ("volume", "words"),
    [
        (np.zeros((2, 2, 3)), r"found shape \(2, 2, 3\), expected the grid's \(2, 2, 2\)"),
        (np.full((2, 2, 2), np.inf), "infinity"),
        (np.zeros((2, 2, 2), complex), "complex128"),
    ],
)
def test_bad_volumes(volume, words):
    with pytest.raises(ValueError, match=words):
        SampledField(volume, VoxelGrid((2, 2, 2), 1.0))
