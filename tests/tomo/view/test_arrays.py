"""What is drawn, as arrays: no server takes part."""

import numpy as np
import pytest

from tomo.draw.scene import ColourScale
from tomo.draw.shapes import box_corners
from tomo.draw.viewpoint import Viewpoint
from tomo.grid import VoxelGrid
from tomo.view.colours import beside_each_other, painted, photographs, plane_values
from tomo.view.rendering import INTEGRAL, MAXIMUM, seen_along
from tomo.view.rig_layer import field_of_view, quaternion
from tomo.view.surfaces import light_surface
from tomo.view.volume_layer import outermost_first
from tomo.view.world import World


def far_view(grid, axis, size):
    """Return a viewpoint far out along an axis: its lines of sight are nearly parallel to it."""
    axes = np.roll(np.eye(3), -axis - 1, axis=0)
    axes[2] = -axes[2]
    axes[1] = np.cross(axes[2], axes[0])
    distance = 1e5
    eye = np.array(grid.center) - distance * axes[2]
    half = grid.extent[(axis + 1) % 3]
    focal = distance * (size[0] / half)
    return Viewpoint(eye, axes, focal, np.array([size[0] - 1, size[1] - 1]) / 2, size)


@pytest.mark.parametrize("axis", range(3))
def test_maximum_and_integral_along_an_axis_are_those_of_the_columns(grid, flames, axis):
    first, second = (axis + 1) % 3, (axis + 2) % 3
    ratio = grid.spacing[second] / grid.spacing[first]
    size = grid.shape[first], round(grid.shape[second] * ratio)
    view = far_view(grid, axis, size)
    columns = {MAXIMUM: flames[0].max(axis=axis)}
    columns[INTEGRAL] = flames[0].sum(axis=axis) * grid.spacing[axis]
    for how, expected in columns.items():
        seen = seen_along(flames[0], grid, view, how, 0.25)
        assert seen.shape == size[::-1]
        expected = expected if axis != 1 else expected.T  # first axis, second axis
        assert seen.max() == pytest.approx(expected.max(), rel=0.06)
        assert seen.sum() * ratio**-1 == pytest.approx(expected.sum(), rel=0.1)


def test_the_integral_of_a_constant_is_the_length_in_the_box():
    grid = VoxelGrid((6, 6, 6), 0.5)
    ones = np.ones(grid.shape, np.float32)
    view = far_view(grid, 0, (9, 9))
    assert seen_along(ones, grid, view, INTEGRAL)[4, 4] == pytest.approx(3.0, rel=1e-3)
    turned = Viewpoint.framing(box_corners(grid.lower, grid.upper), (1, 1, 1), (0, 0, 1), (9, 9))
    seen = seen_along(ones, grid, turned, INTEGRAL)
    assert seen.max() <= 3.0 * np.sqrt(3) + 1e-4
    assert np.count_nonzero(seen == 0)  # lines beside the box


def test_from_inside_only_what_lies_ahead_is_seen(grid):
    volume = np.zeros(grid.shape, np.float32)
    volume[0] = 1.0  # at the lowest x
    ahead = np.array([[0, 1, 0], [0, 0, 1], [1, 0, 0]], float)  # right, down, forward
    view = Viewpoint(np.array(grid.center), ahead, 5.0, np.array([2.0, 2.0]), (5, 5))
    back = Viewpoint(view.eye, ahead * [[1], [-1], [-1]], 5.0, view.principal, (5, 5))
    assert seen_along(volume, grid, view, MAXIMUM).max() == 0
    assert seen_along(volume, grid, back, MAXIMUM)[2, 2] == pytest.approx(1, abs=1e-6)
    with pytest.raises(ValueError, match=r"found shape \(2, 2, 2\)"):
        seen_along(np.zeros((2, 2, 2), np.float32), grid, view, MAXIMUM)


@pytest.mark.parametrize("axis", range(3))
def test_planes_are_interpolated_and_lie_as_the_page_draws_them(grid, axis):
    linear = grid.centers() @ [1.0, 10.0, 100.0]
    level, upright = (axis + 1) % 3, (axis + 2) % 3
    at = grid.center[axis] + 0.3 * grid.spacing[axis]
    plane = plane_values(linear, grid, axis, at)
    assert plane.shape == (grid.shape[upright], grid.shape[level])
    weights = np.array([1.0, 10.0, 100.0])
    first, second = grid.axes()[level], grid.axes()[upright]
    expected = at * weights[axis] + first * weights[level] + second[:, None] * weights[upright]
    np.testing.assert_allclose(plane, expected, rtol=1e-4, atol=1e-2)
    outside = plane_values(linear, grid, axis, grid.upper[axis] + 1)
    np.testing.assert_allclose(outside, plane_values(linear, grid, axis, grid.upper[axis]))


def test_a_fine_surface_is_thinned_and_stays_in_place():
    grid = VoxelGrid((48, 48, 48), 1.0, (5.0, 0.0, 0.0))
    ball = 20 - np.linalg.norm(grid.centers() - grid.center, axis=-1)
    whole = light_surface(ball, grid, 5.0)
    light = light_surface(ball, grid, 5.0, 2000)
    assert len(light[1]) <= 2000 < len(whole[1])
    for vertices, _ in (whole, light):
        radius = np.linalg.norm(vertices - grid.center, axis=1)
        np.testing.assert_allclose(radius, 15, atol=0.6)
    assert len(light_surface(ball, grid, 50.0)[1]) == 0


def test_triangles_are_drawn_from_the_outermost_to_the_middle(grid, flames):
    vertices, triangles = light_surface(flames[1], grid, 0.3)
    ordered = triangles[outermost_first(vertices, triangles, grid)]
    away = np.linalg.norm((vertices - grid.center) / grid.extent, axis=1)[ordered].sum(axis=1)
    assert (np.diff(away) <= 0).all()
    assert {*map(tuple, ordered)} == {*map(tuple, triangles)}


def test_colours_span_the_scale_and_photographs_share_one_brightness():
    scale = ColourScale("", 1.0, 3.0, "gray")
    np.testing.assert_array_equal(
        painted(np.array([0, 1, 2, 3, 9.0, np.nan]), scale)[:, 0], [0, 0, 128, 255, 255, 0]
    )
    shown = photographs({"a": np.full((40, 80), 2.0), "b": np.full((20, 20), 1.0)}, 40)
    assert shown["a"].shape == (20, 40, 3)
    assert shown["b"].shape == (20, 20, 3)
    assert shown["a"].max() == 255
    assert abs(int(shown["b"].max()) - 128) <= 1
    assert photographs({}, 40) == {}
    row = beside_each_other([shown["a"]] * 3, ["one", "two", "three"], 90)
    assert row.shape[1] > 3 * 90
    assert row.shape[2] == 3


def test_a_symbol_has_the_camera_s_proportions_and_turn(content):
    camera = content.rig[1]
    fov, aspect = field_of_view(camera)
    assert aspect == pytest.approx(24 / 28, rel=1e-6)
    assert 0 < fov < np.pi
    w, x, y, z = quaternion(camera.R.T)
    forward = np.array([2 * (x * z + w * y), 2 * (y * z - w * x), w * w - x * x - y * y + z * z])
    np.testing.assert_allclose(forward, camera.R[2], atol=1e-12)


def test_the_page_s_lengths_go_there_and_back(content):
    world = World.of(content)
    points = np.random.default_rng(0).normal(size=(5, 3)) * 100
    np.testing.assert_allclose(world.back(world.points(points)), points)
    np.testing.assert_allclose(world.points(content.grid.center), 0, atol=1e-12)
    assert world.reach == pytest.approx(60.0 / world.unit, rel=1e-6)
