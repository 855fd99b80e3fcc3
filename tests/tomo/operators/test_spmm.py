"""Products with several vectors at once are those of each alone."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import rigs
from tomo.grid import VoxelGrid
from tomo.operators import GaussianBasis, LinearSystem
from tomo.operators.spmv import COLUMNS
from tomo.pipeline.build import in_basis


@pytest.fixture(scope="module")
def operators():
    """Each kind of operator that the default composes, on more unknowns than stay in order."""
    rig = rigs.ring(3, distance=100.0, image_size=(20, 24), footprint=1.0, pitch_degrees=15.0)
    system = LinearSystem.from_rig(rig, VoxelGrid((17, 18, 17), 1.0), skip=False)
    linear, _ = in_basis(system, "linear", 1, "")
    return {
        "stored": system.projector,
        "some pixels": system.projector.take(np.arange(0, system.projector.shape[0], 3)),
        "linear": linear.projector,
        "voxel means": linear.on_voxel_means.projector,
        "blobs": GaussianBasis(linear.projector, 0.8),
    }


KINDS = ["stored", "some pixels", "linear", "voxel means", "blobs"]


@pytest.mark.parametrize("kind", KINDS)
@settings(max_examples=12)
@given(
    columns=st.integers(1, 2 * COLUMNS + 1),
    dtype=st.sampled_from([np.float32, np.float64]),
    seed=st.integers(0, 2**32 - 1),
)
def test_columns_are_the_products_of_each_vector(operators, kind, columns, dtype, seed):
    operator, random = operators[kind], np.random.default_rng(seed)
    volumes = random.standard_normal((operator.shape[1], columns)).astype(dtype)
    images = random.standard_normal((operator.shape[0], columns)).astype(dtype)
    rounding = 1e-6 if dtype == np.float32 else 1e-14
    for product, vectors in ((operator, volumes), (operator.T, images)):
        found = product @ vectors
        alone = np.stack([product @ np.ascontiguousarray(one) for one in vectors.T], axis=1)
        assert found.dtype == dtype
        np.testing.assert_allclose(found, alone, rtol=0, atol=rounding * np.abs(alone).max())


@pytest.mark.parametrize("kind", KINDS)
def test_a_column_has_the_same_bits_whatever_is_beside_it(operators, kind):
    operator, random = operators[kind], np.random.default_rng(1)
    one, others = random.random((operator.shape[1], 3)), random.random((operator.shape[1], 11))
    for places in ([0, 1, 2], [10, 4, 8]):
        others[:, places] = one
        np.testing.assert_array_equal((operator @ others)[:, places], operator @ one)
