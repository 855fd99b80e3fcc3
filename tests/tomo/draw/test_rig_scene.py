import numpy as np
import pytest

from rigs import Camera, Distortion, Rig, look_at
from rigs.scene import Cylinder, Glass, Mesh, Opaque, Sphere, Window
from tomo.draw.rig.rig_scene import Target, border_rays, frustum, rig_scene, up_of
from tomo.draw.rig.surroundings import triangles_of
from tomo.draw.volume.isosurface import isosurface_scene
from tomo.grid import Volume, VoxelGrid

GRID = VoxelGrid((6, 14, 8), (0.5, 1.0, 0.75), (1.0, 2.0, 3.0))


def camera(name="cam00", position=(60.0, 20.0, -40.0), distortion=None, up=(0, 1, 0), focal=400.0):
    R, t = look_at(position, GRID.center, up)
    matrix = [[focal, 2.0, 70.3], [0, 1.1 * focal, 40.9], [0, 0, 1]]
    return Camera(name, (128, 96), matrix, distortion or Distortion(), R, t)


@pytest.mark.parametrize(
    "distortion", [None, Distortion("brown", (-0.2, 0.05, 1e-3, -2e-3))], ids=["none", "brown"]
)
def test_frustum_lies_on_the_camera_s_own_rays(distortion):
    seen = camera(distortion=distortion)
    width, height = seen.image_size
    uv = np.array([[0, 0], [width, 0], [width, height], [0, height]]) - 0.5
    origins, directions = seen.rays(uv)
    corners = frustum(seen, 30.0)
    away = corners - origins
    np.testing.assert_allclose(np.cross(away, directions), 0, atol=1e-9)
    np.testing.assert_allclose(away @ seen.R[2], 30.0)
    back, _, valid = seen.project(corners)
    assert valid.all()
    np.testing.assert_allclose(back, uv, atol=1e-5)


def test_border_of_a_distorted_image_is_sampled_along_its_sides():
    wide = camera(distortion=Distortion("brown", (-0.2, 0.05, 0, 0)), focal=120.0)
    points = frustum(wide, 30.0, per_side=4)
    assert points.shape == (16, 3)
    middle = (points[0] + points[4]) / 2
    assert np.linalg.norm(points[2] - middle) > 0.05  # a curved side does not pass the middle


def test_border_that_the_lens_does_not_map_falls_back_inward():
    folded = camera(distortion=Distortion("brown", (-2.5, 0.0, 0, 0)), focal=60.0)
    width, height = folded.image_size
    corner = folded.rays(np.array([[-0.5, -0.5], [width - 0.5, height - 0.5]]))[1]
    assert np.isnan(corner).any()  # else this tests nothing
    assert np.isfinite(border_rays(folded, 3)).all()


def test_sight_lines_point_from_the_camera_to_the_target_and_stay_outside_the_box():
    rig = Rig((camera(), camera("cam01", (-50, 2, 30))))
    scene = rig_scene(rig, GRID)
    for mesh, seen in zip(scene.only(["sight lines"]).meshes, rig, strict=True):
        line = mesh.vertices - seen.position
        along = line @ seen.R[2]
        off = np.linalg.norm(line - along[:, None] * seen.R[2], axis=1)
        assert off.max() < 0.01 * np.linalg.norm(seen.position)
        assert ((mesh.vertices < GRID.lower) | (mesh.vertices > GRID.upper)).any(axis=1).all()
    for mesh in scene.only(["arrows"]).meshes:
        assert ((mesh.vertices < GRID.lower) | (mesh.vertices > GRID.upper)).any(axis=1).all()


def test_box_bounds_are_the_grid_s_and_the_volume_lies_inside():
    volume = np.zeros(GRID.shape, np.float32)
    volume[2:4, 5:9, 3:6] = 1
    scene = rig_scene(Rig((camera(),)), GRID) + isosurface_scene(Volume(volume, GRID))
    bounds = scene.only(["box"]).bounds
    np.testing.assert_allclose(bounds, [GRID.lower, GRID.upper], atol=0.05)
    surfaces = [g for g in scene.groups if g.startswith("isosurface")]
    assert len(surfaces) == 3
    low, high = scene.only(surfaces).bounds
    start, stop = np.array([2, 5, 3]), np.array([4, 9, 6])
    assert (low >= GRID.lower + (start - 0.5) * GRID.spacing - 1e-6).all()
    assert (high <= GRID.lower + (stop + 0.5) * GRID.spacing + 1e-6).all()


def test_target_without_a_grid_is_where_the_axes_meet():
    rig = Rig((camera(), camera("cam01", (-50, 2, 30)), camera("cam02", (5, 30, 70))))
    np.testing.assert_allclose(Target.of(rig, None).center, GRID.center, atol=1e-9)


@pytest.mark.parametrize("names", [["one"], ["one", "two"]])
def test_one_camera_or_parallel_ones_still_make_a_scene(names):
    cameras = tuple(
        Camera(n, (8, 8), [[80, 0, 4], [0, 80, 4], [0, 0, 1]], t=[3.0 * i, 0, 100])
        for i, n in enumerate(names)
    )
    assert np.isfinite(rig_scene(Rig(cameras)).bounds).all()


@pytest.mark.parametrize("up", [(0, 1, 0), (0, -1, 0), (0, 0, 1), (1, 0, 0)])
def test_upward_is_what_the_images_show_upward(up):
    level = np.cross(up, [0.36, 0.48, 0.8])
    positions = [np.add(GRID.center, 70 * way) + np.multiply(20, up) for way in (level, -level)]
    rig = Rig(tuple(camera(f"{i}", p, up=up) for i, p in enumerate(positions)))
    assert up_of(rig).vector.tolist() == list(up)


class Ring:
    """A solid of a user's own."""

    name, material = "ring", Opaque()


def test_a_solid_of_another_type_is_not_drawn_and_says_so():
    with pytest.raises(ValueError, match="solid ring: found Ring, expected a Window"):
        triangles_of(Ring(), 100.0)


@pytest.mark.parametrize(
    "solid",
    [
        Window("s", (0, 0, 40), (0.3, 0, 1), 5, Glass(1.5), size=(30, 20), across=(0, 1, 0)),
        Window("s", (0, 0, 40), (0.3, 0.2, 1), 5, Glass(1.5), size=30),
        Cylinder("s", (0, 0, 40), (1, 0.5, 0), 6, 20, Glass(1.5), inner_radius=4),
        Sphere("s", (0, 0, 40), 6, Opaque()),
    ],
    ids=["rectangle", "disc", "tube", "ball"],
)
def test_solids_are_drawn_where_they_are(solid):
    vertices, triangles = triangles_of(solid, 100.0)
    drawn = Mesh("drawn", vertices, triangles, Glass(1.5))  # checks that it is closed
    middle, reach = vertices.mean(axis=0), np.ptp(vertices, axis=0) * 0.6
    points = middle + np.random.default_rng(0).uniform(-1, 1, (3000, 3)) * reach
    inside = solid.contains(points)
    assert 0.05 < inside.mean() < 0.6
    assert (drawn.contains(points) == inside).mean() > 0.99  # but for facets
