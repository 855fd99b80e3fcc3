"""A camera behind windows and mirrors: its pixels, rays and points, and its rig's file."""

import dataclasses
import pickle

import numpy as np
import pytest
import trimesh

from rigs import Camera, Distortion, Rig, Volume, formats, load_rig, look_at, save_rig
from rigs.changes import as_ray_tables, with_cameras
from rigs.scene import Cylinder, Glass, Mesh, Mirror, Opaque, Scene, SceneCamera, Sphere, Window
from tomo.grid import VoxelGrid
from tomo.model.pose import moved
from tomo.operators.operator import dot_test
from tomo.operators.system import LinearSystem
from tomo.rays import Rays
from tomo.trace import tracing

from . import closed_forms as forms

GLASS = Window("pane", (0, 0, 60), (0.3, 0.1, 1), 10, Glass("quartz"), size=80)


def camera(position=(0.0, 20, 300), name="cam00", target=(0, 0, 0), size=(60, 48)):
    R, t = look_at(position, target)
    lens = Distortion("brown", (-0.1, 0.03, 0, 0))
    return Camera(name, size, [[600, 0, 29.5], [0, 600, 23.5], [0, 0, 1]], lens, R, t)


def rig(scene):
    cameras = (camera(), camera((200, 30, 220), "cam01"), camera((-250, 0, 180), "cam02"))
    return Rig(cameras, volume=Volume((12, 10, 8), 1.5)).through(scene)


def knob():
    shape = trimesh.creation.icosphere(subdivisions=3, radius=6)
    return Mesh("knob", shape.vertices + np.array([3, 0, 100]), shape.faces, Opaque())


def points(count=200, reach=8.0):
    return np.random.default_rng(0).uniform(-reach, reach, (count, 3))


def miss(origins, directions, at):
    away = at - origins
    return np.linalg.norm(away - (away * directions).sum(1)[:, None] * directions, axis=1)


@pytest.mark.parametrize(
    "solid",
    [GLASS, Cylinder("tube", (0, 0, 0), (0, 1, 0), 30, 200, Glass(1.47), inner_radius=26)],
    ids=["window", "tube"],
)
def test_the_pixel_of_a_point_looks_at_the_point(solid):
    seen = SceneCamera(camera(), Scene((solid,)))
    uv, depth, valid = seen.project(points())
    assert valid.all()
    assert seen.sees_once
    assert (depth > 0).all()
    assert miss(*seen.rays(uv), points()).max() < 1e-9  # a pixel is 0.5 wide there
    assert np.abs(uv - camera().project(points())[0]).max() > 0.1


def test_through_air_alone_it_is_the_camera_itself():
    seen = SceneCamera(camera(), Scene((dataclasses.replace(GLASS, material=Glass(1.0)),)))
    uv, _, valid = seen.project(points())
    assert valid.all()
    np.testing.assert_allclose(uv, camera().project(points())[0], atol=1e-9)
    np.testing.assert_allclose(seen.rays()[1], camera().rays()[1], atol=1e-12)


def test_by_a_mirror_it_is_the_virtual_camera():
    mirror = Mirror("m", (60, 0, 0), (-1, 0, 1), size=90)
    own = camera((60.0, 0, 300), target=(60, 0, 0))
    seen = SceneCamera(own, Scene((mirror,)))
    uv, depth, valid = seen.project(points())
    assert valid.all()
    assert seen.sees_once
    virtual = forms.mirror_image(own.position[None], mirror.point, mirror.normal)[0]
    np.testing.assert_allclose(seen.position, virtual, atol=1e-6)
    wanted, _, _ = own.project(forms.mirror_image(points(), mirror.point, mirror.normal))
    np.testing.assert_allclose(uv, wanted, atol=1e-8)
    np.testing.assert_allclose(depth, np.linalg.norm(points() - virtual, axis=1), rtol=0.02)


def test_a_camera_with_a_mirror_in_half_of_its_image_may_see_a_point_twice():
    half = Mirror("m", (40, 0, 0), (-1, 0, 0.2), size=60)
    wide = camera((0.0, 0, 300), target=(20, 0, 0), size=(160, 48))
    wide = dataclasses.replace(wide, camera_matrix=[[600, 0, 79.5], [0, 600, 23.5], [0, 0, 1]])
    assert not SceneCamera(wide, Scene((half,))).sees_once


def test_points_behind_hardware_are_not_seen():
    seen = SceneCamera(camera((0.0, 0, 300)), Scene((knob(),)))
    at = np.array([[4.5, 0, 0], [0, 8.0, 0], [3, 0, 150]])
    assert seen.project(at)[2].tolist() == [
        False,
        True,
        True,
    ]  # behind, above, and before the knob
    _, directions = seen.rays(camera((0.0, 0, 300)).project(at)[0])
    assert np.isnan(directions).all(axis=1).tolist() == [True, False, True]


def test_images_that_are_changed_keep_what_pixels_see():
    seen = SceneCamera(camera(), Scene((GLASS,)))
    uv = np.array([[20.0, 12], [31.5, 30]])
    pairs = {
        "cropped": (seen.cropped(8, 6, 30, 30), uv - [8, 6]),
        "scaled": (seen.scaled(0.5), (uv + 0.5) / 2 - 0.5),
        "shifted": (seen.shifted(2.5, -1), uv + np.array([2.5, -1])),
        "rotated": (seen.rotated(90), np.stack([47 - uv[:, 1], uv[:, 0]], axis=1)),
    }
    for changed, there in pairs.values():
        for found, wanted in zip(changed.rays(there), seen.rays(uv), strict=True):
            np.testing.assert_allclose(found, wanted, atol=1e-9)
    R, t = look_at((1.0, 2, 3), (0, 1, -2))
    for found, wanted in zip(
        seen.transformed(R, t).project(points() @ R.T + t)[:1], seen.project(points())[:1],
        strict=True,
    ):  # fmt: skip
        np.testing.assert_allclose(found, wanted, atol=1e-7)
    far = seen.with_lengths_scaled(1e-3)
    np.testing.assert_allclose(
        far.project(1e-3 * points())[0], seen.project(points())[0], atol=1e-7
    )


def test_a_rig_and_its_scene_come_back_from_the_file_and_from_another_process(tmp_path):
    scene = Scene(
        (
            dataclasses.replace(GLASS, beyond="water"),
            Cylinder("rod", (120.0, 0, 100), (0, 1, 0), 3, 50, Opaque()),
            Sphere("bead", (-90, 10, 80), 4, Glass("bk7", extinction=0.01)),
            Mirror("m", (0, -90, 0), (0, 1, 0), size=(20, 30), across=(1, 0, 0)),
            knob(),
        ),
        medium="air",
        fresnel=True,
    )
    one = rig(scene)
    save_rig(one, tmp_path / "rig.yaml")
    again = load_rig(tmp_path / "rig.yaml")
    assert again == one
    assert again.scene == scene
    again[0].project(points())  # Open3D's tree is made and must not be sent along
    assert pickle.loads(pickle.dumps(again)) == one


def test_tables_of_rays_see_what_the_scene_s_cameras_see():
    one = rig(Scene((GLASS,)))
    tables = as_ray_tables(one)
    assert tables.scene is None
    for camera, table in zip(one, tables, strict=True):
        (seen, _, known), (there, _, valid) = camera.project(points()), table.project(points())
        assert (known == valid).mean() > 0.9  # but for points behind the window's rim
        both = known & valid
        np.testing.assert_allclose(there[both], seen[both], atol=1e-3)  # linear between pixels
    renamed = with_cameras(one, {"cam01": "front"})
    assert renamed.names == ("front",)
    assert renamed.scene == one.scene
    with pytest.raises(ValueError, match=r"scene: found pane, which .* lacks: .*--ray-tables"):
        formats.save(one, "never.json")


@pytest.mark.parametrize("form", ["stored", "on-the-fly"])
def test_operators_look_through_the_scene(form):
    scene = Scene((GLASS, knob()))
    grid = VoxelGrid((12, 10, 8), 1.5)
    system = LinearSystem.from_rig(rig(scene), grid, form=form, supersample=2)
    for dtype, tolerance in ((np.float64, 1e-12), (np.float32, 1e-6)):
        assert dot_test(system.projector, dtype=dtype) < tolerance
    plain = LinearSystem.from_rig(rig(Scene()), grid, form=form, supersample=2)
    ones = np.ones(grid.size, np.float32)
    dimmed, full = (s.images(s.projector @ ones)[0] for s in (system, plain))
    assert dimmed.sum() < 0.9 * full.sum()
    hidden = dimmed[full > 0] == 0
    assert 0.05 < hidden.mean() < 0.5  # what the knob covers


def test_chord_sums_are_the_paths_lengths_inside_the_grid():
    """Constant emission: the sum of segments is the length of the path in the box, to 1e-10."""
    seen = SceneCamera(camera(), Scene((GLASS, Mirror("m", (0, 0, -40), (0.1, 0, 1), size=50))))
    grid = VoxelGrid((12, 10, 8), 1.5)
    rays = Rays.from_camera(seen)
    segments = tracing(grid, "reference")(rays)
    sums = np.add.reduceat(np.append(segments.length, 0), segments.ptr[:-1])
    sums[np.diff(segments.ptr) == 0] = 0
    inside = np.zeros(rays.n_pixels)
    for pixel in range(rays.n_pixels):
        for piece in range(rays.pixel_ptr[pixel], rays.pixel_ptr[pixel + 1]):
            low, high = 0.0, rays.lengths[piece]
            for axis in range(3):
                ends = (
                    np.array([grid.lower[axis], grid.upper[axis]]) - rays.origins[piece, axis]
                ) / rays.directions[piece, axis]
                low, high = max(low, ends.min()), min(high, ends.max())
            inside[pixel] += max(high - low, 0)
    assert (inside > 15).mean() > 0.1  # there and back by the mirror
    np.testing.assert_allclose(sums, inside, atol=1e-10)


def test_fresnel_dims_what_is_seen_behind_a_window():
    plain, dimmed = rig(Scene((GLASS,))), rig(Scene((GLASS,))).with_fresnel(True)
    sums = [
        LinearSystem.from_rig(one, VoxelGrid((12, 10, 8), 1.5)).projector.row_sums.sum()
        for one in (Rig(plain.cameras[:1]), Rig(dimmed.cameras[:1]))
    ]
    reflected = ((1.4585 - 1) / (1.4585 + 1)) ** 2  # at normal incidence; twenty degrees differ
    assert sums[1] / sums[0] == pytest.approx((1 - reflected) ** 2, abs=0.002)
    with pytest.raises(ValueError, match="fresnel: found True without a scene"):
        Rig((camera(),)).with_fresnel(True)


def test_a_camera_moves_behind_its_window_and_not_behind_a_mirror():
    motion = np.array([0.4, -0.3, 2, 1, 0, 0])
    air = dataclasses.replace(GLASS, material=Glass(1.0))
    seen = moved(SceneCamera(camera(), Scene((air,))), motion, np.zeros(3))
    wanted = moved(camera(), motion, np.zeros(3)).project(points())[0]
    np.testing.assert_allclose(seen.project(points())[0], wanted, atol=1e-8)
    assert seen.scene == Scene((air,))
    assert not SceneCamera(camera(), Scene((Mirror("m", (0, 0, -90), (0, 0, 1)),))).has_pose
