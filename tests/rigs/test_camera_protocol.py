import ast
import inspect
import re
from pathlib import Path

import numpy as np
import pytest

from rigs import Camera, CameraLike, RayTable, Rig, ring
from rigs.check import check_points
from rigs.scene import Scene, SceneCamera

ROOT = Path(__file__).resolve().parent.parent.parent
BY_KIND = {"rigs/camera.py", "rigs/ray_table/ray_table.py", "rigs/files/write_rig.py"}
CAMERAS = tuple(ring(5, distance=100.0, image_size=(40, 30), footprint=0.5))


class Borrowed:
    """A camera of another kind: it has the members of the protocol and no others."""

    def __init__(self, camera):
        for name in members():
            if not callable(getattr(Camera, name, None)):
                setattr(self, name, getattr(camera, name))
        self.has_lens_model = self.is_pinhole = False
        self.camera = camera

    def project(self, points):
        return self.camera.project(points)

    def rays(self, uv=None):
        return self.camera.rays(uv)

    def inside(self, uv):
        return self.camera.inside(uv)


def members():
    fields = set(inspect.get_annotations(CameraLike))
    return fields | {name for name in vars(CameraLike) if not name.startswith("_")}


@pytest.mark.parametrize(
    "camera", [CAMERAS[0], RayTable.of(CAMERAS[0]), SceneCamera(CAMERAS[0], Scene())]
)
def test_all_kinds_of_camera_satisfy_the_protocol(camera):
    assert {"project", "rays", "position", "has_lens_model"} <= members()
    for name in members():
        assert getattr(camera, name) is not None or name in ("optics", "accuracy")
    for moved in (
        camera.scaled(0.5),
        camera.cropped(1, 2, 20, 10),
        camera.rotated(90),
        camera.shrunk(2),
        camera.shifted(1.0, 2.0),
        camera.transformed(np.eye(3), np.ones(3)),
        camera.with_lengths_scaled(10.0),
        camera.renamed("other"),
    ):
        assert type(moved) is type(camera)


def test_lengths_scale_with_the_world():
    for camera in (CAMERAS[1], RayTable.of(CAMERAS[1])):
        larger = camera.with_lengths_scaled(10.0)
        np.testing.assert_allclose(larger.position, 10 * camera.position)
        points = np.array([[1.0, 2, -3], [0.5, 0, 4]])
        np.testing.assert_allclose(
            larger.project(10 * points)[0], camera.project(points)[0], atol=1e-6
        )


def test_a_camera_of_another_kind_serves_in_a_rig():
    points = np.stack(np.meshgrid(*[np.linspace(-4, 4, 4)] * 3), axis=-1).reshape(-1, 3)
    known = check_points(Rig(CAMERAS), points, (8, 8, 8), 0.5)
    other = check_points(Rig(tuple(map(Borrowed, CAMERAS))), points, (8, 8, 8), 0.5)
    np.testing.assert_array_equal(other.coverage.seen, known.coverage.seen)
    np.testing.assert_allclose(other.coverage.footprint, known.coverage.footprint, rtol=1e-6)
    with pytest.raises(ValueError, match=r"rig cameras\[0\]: found 3, expected a Camera"):
        Rig((3,))


def test_only_serialisers_ask_for_the_kind_of_a_camera():
    asking = set()
    for folder in ("rigs", "tomo", "tools"):
        for path in (ROOT / folder).rglob("*.py"):
            source = path.read_text()
            if "isinstance" not in source or not re.search("Camera|RayTable", source):
                continue
            for node in ast.walk(ast.parse(source)):
                is_test = isinstance(node, ast.Call) and ast.unparse(node.func) == "isinstance"
                if is_test and {"Camera", "RayTable"} & {
                    name.id for name in ast.walk(node.args[1]) if isinstance(name, ast.Name)
                }:
                    asking.add(path.relative_to(ROOT).as_posix())
    assert asking == BY_KIND
