import numpy as np
import pytest

from tomo.draw.volume.isosurface import coarsened, isosurface, isosurface_scene
from tomo.grid import Volume, VoxelGrid

# Different counts, spacings and offsets along every axis: no mix-up of axes can pass.
GRID = VoxelGrid((30, 52, 41), (0.5, 0.25, 0.4), (3.0, -7.0, 11.0))
MIDDLE = np.array([2.0, -6.0, 12.5])


def ball(sigma=1.4):
    squares = ((GRID.centers() - MIDDLE) ** 2).sum(axis=-1)
    return np.exp(-squares / (2 * sigma**2)).astype(np.float32)


def test_surface_of_a_gaussian_is_a_sphere_of_the_right_radius_and_place():
    sigma = 1.4
    vertices, triangles = isosurface(ball(sigma), GRID, 0.5)
    radius = sigma * np.sqrt(2 * np.log(2))
    distances = np.linalg.norm(vertices - MIDDLE, axis=1)
    np.testing.assert_allclose(distances, radius, rtol=0.02)
    assert len(triangles) > 500


def test_a_volume_that_touches_the_box_is_closed_at_its_faces():
    vertices, triangles = isosurface(np.ones(GRID.shape, np.float32), GRID, 0.5)
    np.testing.assert_allclose(vertices.min(axis=0), GRID.lower, atol=1e-5)
    np.testing.assert_allclose(vertices.max(axis=0), GRID.upper, atol=1e-5)
    edges = np.sort(triangles[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), axis=1)
    assert (np.unique(edges, axis=0, return_counts=True)[1] == 2).all()


def test_bad_level_and_shape_are_refused():
    with pytest.raises(ValueError, match="level: found 0"):
        isosurface(ball(), GRID, 0)
    with pytest.raises(ValueError, match="volume: found shape"):
        isosurface(ball()[1:], GRID, 0.5)


def test_dark_volume_has_no_surface_and_a_hot_voxel_hides_nothing():
    assert not isosurface_scene(Volume(np.zeros(GRID.shape), GRID)).meshes
    hot = ball()
    hot[0, 0, 0] = 1e6
    extents = [
        np.ptp(m.vertices, axis=0).min() for m in isosurface_scene(Volume(hot, GRID)).meshes
    ]
    assert len(extents) == 3
    assert max(extents) > 1.0


def test_coarsening_keeps_the_integral_and_the_place():
    grid = VoxelGrid((8, 12, 16), (0.5, 0.25, 0.4), (1, 2, 3))
    data = np.random.default_rng(0).random(grid.shape).astype(np.float32)
    small = coarsened(Volume(data, grid), max_voxels=grid.size // 8)
    assert small.grid.shape == (4, 6, 8)
    np.testing.assert_allclose(small.grid.lower, grid.lower)
    np.testing.assert_allclose(small.grid.upper, grid.upper)
    np.testing.assert_allclose(
        small, grid.average(data, 1).reshape(4, 2, 6, 2, 8, 2).mean((1, 3, 5)), rtol=1e-5
    )
    assert coarsened(Volume(data, grid)).grid == grid
