"""Several sets of images at once give the volumes that each gives alone."""

import numpy as np
import pytest

import phantoms
import rigs
from tomo.grid import VoxelGrid
from tomo.losses import LeastSquares
from tomo.operators import LinearSystem
from tomo.solvers import curvature, mlem
from tomo.solvers.curvature import curvature_of_several
from tomo.solvers.initial_volume import mlos_start
from tomo.solvers.mlem import mlem_of_several


@pytest.fixture(scope="module")
def film():
    """A projector, the images of four emissions of very different brightness, and weights."""
    grid = VoxelGrid((14, 18, 14), 1.0)
    rig = rigs.ring(4, distance=200.0, image_size=(18, 22), footprint=1.0, pitch_degrees=12.0)
    projector = LinearSystem.from_rig(rig, grid, skip=False).projector
    flame = phantoms.create("jet", 1, grid.extent, grid.center)(grid.centers().reshape(-1, 3))
    random = np.random.default_rng(0)
    truths = np.stack([flame, 1e-3 * flame[::-1], 200 * np.sqrt(flame), flame**2], axis=1)
    images = projector @ truths.astype(np.float32)
    images += 0.02 * images.max(axis=0) * random.standard_normal(images.shape)
    weights = random.uniform(0.2, 1.0, images.shape) * np.array([1, 1, 1e-4, 1e4])
    return projector, images.astype(np.float32), weights.astype(np.float32)


def relative(found, expected):
    return np.linalg.norm(found - expected) / np.linalg.norm(expected)


def test_starts_are_those_of_each(film):
    projector, images, _ = film
    starts = mlos_start(projector, images)
    for column, image in enumerate(images.T):
        assert relative(starts[:, column], mlos_start(projector, image)) < 1e-6


def test_mlem_of_several_is_mlem_of_each(film):
    projector, images, _ = film
    start = mlos_start(projector, images)
    found = mlem_of_several(projector, images, iterations=8, start=start)
    for column, image in enumerate(images.T):
        alone = mlem(projector, image, iterations=8, start=start[:, column])
        assert relative(found[:, column], alone.volume.ravel()) < 1e-5


@pytest.mark.parametrize("weighted", [False, True])
def test_curvature_of_several_is_curvature_of_each(film, weighted):
    projector, images, weights = film
    start = mlos_start(projector, images)
    how = {"strength": 1e-3, "iterations": 25}
    found = curvature_of_several(
        projector, images, start=start, weights=weights if weighted else None, **how
    )
    assert (found >= 0).all()
    for column, image in enumerate(images.T):
        own = weights[:, column] if weighted else None
        alone = curvature(projector, image, start=start[:, column], weights=own, **how)
        assert relative(found[:, column], alone.volume.ravel()) < 1e-4


def test_a_dark_column_stays_dark_and_leaves_the_others(film):
    projector, images, _ = film
    dark = images.copy()
    dark[:, 1] = 0
    start = mlos_start(projector, dark)
    found = curvature_of_several(projector, dark, strength=1e-3, iterations=10, start=start)
    assert not found[:, 1].any()
    kept = [0, 2, 3]
    others = curvature_of_several(
        projector, dark[:, kept], strength=1e-3, iterations=10, start=start[:, kept]
    )
    np.testing.assert_array_equal(found[:, kept], others)


def test_weights_of_another_shape_are_refused(film):
    projector, images, weights = film
    with pytest.raises(ValueError, match=r"weights: found shape \(.*\), expected \(.*4\)"):
        LeastSquares(projector, images, weights[:, :3])
