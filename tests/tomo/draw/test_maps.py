from dataclasses import replace

import matplotlib.image
import numpy as np
import pytest
import trimesh

from rigs import check_rig, look_at, ring
from rigs.check.rig_check import lattice
from tomo.draw import Viewpoint, write_glb
from tomo.draw.figures import save_figure
from tomo.draw.raster import render
from tomo.draw.rig.rig_page import coverage_maps, coverage_scene, draw_coverage
from tomo.draw.rig.surroundings import target_scene
from tomo.draw.scene import ColourScale
from tomo.draw.volume.planes import lattice_triangles, map_scene
from tomo.grid import Volume, VoxelGrid

GRID = VoxelGrid((5, 8, 6), (1.0, 0.5, 2.0), (1.0, 2.0, 3.0))


def test_planes_carry_the_volume_s_own_values():
    x, y, z = np.moveaxis(GRID.centers(), -1, 0)
    values = 2 * x - 3 * y + z  # linear: the mean of two layers is the value between them
    scene = map_scene(Volume(values, GRID), "field", ColourScale.of("field", values))
    assert scene.groups == ("map: field",)
    assert [mesh.name.split(", ")[1][0] for mesh in scene.meshes] == ["x", "y", "z"]
    for axis, mesh in enumerate(scene.meshes):
        np.testing.assert_allclose(mesh.vertices[:, axis], GRID.center[axis])
        np.testing.assert_allclose(mesh.values, mesh.vertices @ [2, -3, 1])
        sides = [n for a, n in enumerate(GRID.shape) if a != axis]
        assert len(mesh.triangles) == 2 * (sides[0] - 1) * (sides[1] - 1)


def test_a_lattice_is_covered_once():
    points = np.stack(np.meshgrid(range(4), range(7), indexing="ij"), axis=-1).reshape(-1, 2)
    a, b, c = (points[lattice_triangles(4, 7)[:, k]] for k in range(3))
    areas = np.cross(np.pad(b - a, ((0, 0), (0, 1))), np.pad(c - a, ((0, 0), (0, 1))))[:, 2] / 2
    assert np.abs(areas).sum() == 18
    assert len(set(np.sign(areas))) == 1


def test_a_scale_spans_what_there_is():
    scale = ColourScale.of("q", np.array([1.0, np.nan, 3.0]), "gray")
    assert (scale.lower, scale.upper) == (1.0, 3.0)
    np.testing.assert_allclose(scale(np.array([0.0, 2.0, 9.0]))[:, 0], [0, 0.5, 1], atol=0.01)
    np.testing.assert_allclose(scale(np.array([np.nan])), 0.8)
    one = ColourScale.of("q", np.full(4, 7.0))
    assert one.lower < 7 < one.upper
    assert ColourScale.of("q", np.full(2, np.nan)).upper == 1


def test_values_are_the_same_colours_in_a_picture_and_in_glb(tmp_path):
    values = np.full(GRID.shape, 0.25)
    scale = ColourScale("m", 0.0, 1.0, "viridis")
    scene = map_scene(Volume(values, GRID), "m", scale)
    viewpoint = Viewpoint.framing(scene.bounds, (0.3, 0.4, 1.0), (0, 1, 0), (60, 60))
    middle = render(scene, viewpoint, 1)[30, 30]
    np.testing.assert_allclose(middle, scale(np.array(0.25)), atol=0.01)  # no shading
    write_glb(tmp_path / "m.glb", scene)
    loaded = next(iter(trimesh.load(tmp_path / "m.glb").geometry.values()))
    linear = scale(np.array(0.25)) ** 2.2
    np.testing.assert_allclose(loaded.visual.vertex_colors[0, :3] / 255, linear, atol=0.03)


@pytest.mark.parametrize("shape", [(30, 140, 30), (2, 3, 1), (7, 400, 7)])
def test_points_of_a_check_reach_the_outermost_voxels_and_the_middle(shape):
    grid = VoxelGrid(shape, (0.5, 0.25, 1.0), (1.0, 2.0, 3.0))
    box = lattice(grid)
    coarse = VoxelGrid(box.shape, box.spacing, box.center)
    assert coarse.size <= 3000
    for axis, (wanted, found) in enumerate(zip(grid.axes(), coarse.axes(), strict=True)):
        if shape[axis] > 1:
            np.testing.assert_allclose(found[[0, -1]], wanted[[0, -1]])
        if shape[axis] > 2:
            assert len(found) % 2 == 1
            assert len(found) >= min(5, shape[axis] - 1)


@pytest.fixture(scope="module")
def checked():
    grid = VoxelGrid((20, 60, 20), 0.5)
    rig = ring(5, distance=300.0, image_size=(90, 90), footprint=0.3, pitch_degrees=5.0)
    return check_rig(rig, grid)


def test_coverage_is_mapped_with_what_is_known(checked):
    maps = coverage_maps(checked)
    assert [shown.heading for shown in maps] == ["views", "details", "pixel size", "ray-miss"]
    views = maps[0].volume
    assert views[tuple(n // 2 for n in views.shape)] == 5
    assert views[:, 0].max() == 0  # the ends of the box are outside every image
    assert np.nanmedian(maps[2].volume) == pytest.approx(0.6, rel=0.05)
    scene = coverage_scene(maps)
    assert scene.groups == tuple(f"map: {shown.heading}" for shown in maps)


def test_the_maps_picture_shows_the_unseen_ends(checked, tmp_path):
    maps = coverage_maps(checked)
    save_figure(draw_coverage(maps, title="<$x^$>"), tmp_path / "maps.png")
    picture = matplotlib.image.imread(tmp_path / "maps.png")[..., :3]
    assert min(picture.shape[:2]) > 500
    for values in (0.0, 5.0):  # the colours of no view and of all
        colour = maps[0].scale(np.array(values))
        assert (np.abs(picture - colour).max(axis=2) < 0.02).mean() > 0.003
    assert [p.name for p in tmp_path.iterdir()] == ["maps.png"]


def test_targets_stay_with_their_rig_when_it_is_moved():
    rig = ring(4, distance=300.0, image_size=(90, 90), footprint=0.3)
    corners = np.array([[-5.0, -5, 0], [5, -5, 0], [5, 5, 2], [-5, 5, 2]])
    held = corners @ rig[1].R.T + rig[1].t
    pose = {"frame": "a", "camera": "cam01", "corners": held.tolist()}
    rig = replace(rig, calibration={"target_poses": [pose]})
    turn = look_at((3, 1, 2), (0, 0, 0))[0]
    for seen, wanted in (
        (rig, corners),
        (rig.transformed(turn, [1.0, 2.0, 3.0]), corners @ turn.T + [1, 2, 3]),
    ):
        scene = target_scene(seen)
        assert scene.groups == ("targets", "target names")
        np.testing.assert_allclose(scene.meshes[1].vertices[1:], wanted, atol=1e-9)
    assert target_scene(rig.without("cam01")).groups == ()
    assert target_scene(replace(rig, calibration=None)).groups == ()
