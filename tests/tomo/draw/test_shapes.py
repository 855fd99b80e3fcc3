import numpy as np
import pytest
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st

from tomo.draw import shapes
from tomo.grid import VoxelGrid

GRID = VoxelGrid((3, 10, 5), (0.5, 0.2, 1.0), (4.0, -2.0, 7.0))
coordinate = st.floats(-100, 100, allow_nan=False)
point = st.tuples(coordinate, coordinate, coordinate)


def as_trimesh(triangles):
    return trimesh.Trimesh(*triangles, process=False)


@settings(max_examples=40, deadline=None)
@given(point, point)
def test_tube_is_a_closed_solid_of_the_prism_s_volume(start, end):
    length = np.linalg.norm(np.subtract(end, start))
    if length < 1e-3:
        return
    radius, sides = 0.01 * length, 6
    tube = as_trimesh(shapes.tubes([start], [end], radius, sides=sides))
    assert tube.is_watertight
    section = sides / 2 * radius**2 * np.sin(2 * np.pi / sides)
    assert tube.volume == pytest.approx(section * length, rel=1e-6)  # positive: faces look outward


def test_tapered_tube_ends_in_a_point():
    tube = as_trimesh(shapes.tubes([[0, 0, 0]], [[0, 0, 3]], 1.0, 0.0, sides=64))
    assert tube.volume == pytest.approx(np.pi, rel=2e-2)  # a cone


def test_a_tube_without_length_is_left_out():
    vertices, triangles = shapes.tubes([[1, 1, 1], [0, 0, 0]], [[1, 1, 1], [0, 0, 1]], 0.1)
    assert np.isfinite(vertices).all()
    assert triangles.max() == len(vertices) - 1


def test_box_wires_bound_the_grid_exactly():
    vertices, triangles = shapes.box_wires(GRID, 0.01)
    np.testing.assert_allclose(vertices.min(axis=0), GRID.lower - 0.01, atol=1e-12)
    np.testing.assert_allclose(vertices.max(axis=0), GRID.upper + 0.01, atol=1e-12)
    bars = trimesh.Trimesh(vertices, triangles, process=False).split()
    assert len(bars) == 12
    assert all(bar.is_watertight and bar.volume > 0 for bar in bars)
