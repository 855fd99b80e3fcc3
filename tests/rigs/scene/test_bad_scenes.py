"""Scenes that cannot be: one line that names the solid, what was found and what was expected."""

import re

import numpy as np
import pytest
import trimesh
import yaml

from rigs import Camera, Rig, Volume, load_rig, look_at, save_rig
from rigs.scene import Mesh, Opaque, Scene
from rigs.scene.mesh import LARGEST

WINDOW = {"name": "pane", "type": "window", "point": [0, 0, 60], "normal": [0, 0, 1],
          "thickness": 10, "index": 1.46, "size": 40}  # fmt: skip
BALL = {"name": "ball", "type": "sphere", "center": [0, 0, 60], "radius": 5, "material": "opaque"}
MESH = {"name": "part", "type": "mesh", "file": "part.stl", "material": "opaque"}


@pytest.fixture(scope="module")
def plain(tmp_path_factory):
    """The file of a rig without a scene."""
    R, t = look_at((0, 0, 300), (0, 0, 0))
    camera = Camera("cam03", (20, 16), [[200, 0, 9.5], [0, 200, 7.5], [0, 0, 1]], R=R, t=t)
    path = tmp_path_factory.mktemp("rig") / "rig.yaml"
    save_rig(Rig((camera,), volume=Volume((10, 10, 10), 1.0)), path)
    return path.read_text()


@pytest.fixture
def load(plain, tmp_path):
    def load(*solids, **scene):
        data = yaml.safe_load(plain) | {"scene": {"solids": list(solids), **scene}}
        (tmp_path / "rig.yaml").write_text(yaml.safe_dump(data))
        return load_rig(tmp_path / "rig.yaml")

    load.folder = tmp_path
    return load


def without(entry, *names):
    return {name: value for name, value in entry.items() if name not in names}


CASES = {
    "camera inside glass": ([BALL | {"center": [0, 0, 300], "material": "glass", "index": 1.5}],
                            "camera cam03: stands inside solid ball"),
    "window in the grid": ([WINDOW | {"point": [0, 0, 8]}], "solid pane: reaches into the volume"),
    "ball round the grid": ([BALL | {"center": [0, 0, 0], "radius": 30, "material": "glass",
                                     "index": 1.5}], "solid ball: reaches into the volume"),
    "index below 1": ([WINDOW | {"index": 0.9}], "solid pane: index: found 0.9"),
    "index by a wrong name": ([WINDOW | {"index": "gelatine"}], "solid pane: index: found 'gel"),
    "another unit": ([WINDOW | {"size": 0.04, "point": [0, 0, 0.06], "thickness": 0.01}],
                     "check the units"),
    "overlap": ([WINDOW, BALL], "solids pane and ball: found one in the other"),
    "one name twice": ([BALL, WINDOW | {"name": "ball", "point": [0, 0, 90]}], "found twice"),
    "thickness of 0": ([WINDOW | {"thickness": 0}], "solid pane: thickness: found 0"),
    "no thickness": ([without(WINDOW, "thickness")], "solid pane: thickness: missing"),
    "no index": ([without(WINDOW, "index")], "solid pane: index: missing"),
    "radius of a window": ([WINDOW | {"radius": 3}], "radius: found, expected no such"),
    "unknown field": ([WINDOW | {"colour": "red"}], "solid pane: colour"),
    "unknown type": ([WINDOW | {"type": "pane"}], "type: found 'pane'"),
    "no material": ([without(BALL, "material")], "solid ball: material: missing"),
    "opaque window": ([WINDOW | {"material": "opaque"}], "found 'opaque', expected glass"),
    "normal of length 0": ([WINDOW | {"normal": [0, 0, 0]}], "normal: found"),
    "tube without bore": ([{"name": "t", "type": "cylinder", "point": [0, 0, 90], "length": 9,
                            "axis": [0, 1, 0], "radius": 5, "inner_radius": 6,
                            "material": "opaque"}], "inner_radius: found 6"),
    "no file": ([MESH], "part.stl: no such file"),
    "file outside": ([MESH | {"file": "../part.stl"}], "expected a path inside the rig's folder"),
    "NaN": ([WINDOW | {"point": [0, 0, float("nan")]}], "solid pane: point"),
}  # fmt: skip


@pytest.mark.parametrize("case", CASES)
def test_a_scene_that_cannot_be_is_refused_in_one_line(load, case):
    solids, expected = CASES[case]
    with pytest.raises((ValueError, FileNotFoundError)) as error:
        load(*solids)
    message = str(error.value)
    assert re.search(re.escape(expected), message), message
    assert "\n" not in message
    assert "rig.yaml" in message or "part.stl" in message


class Ring:
    """A solid of a user's own."""

    name, material, diameter = "ring", Opaque(), 1.0

    def samples(self):
        return np.zeros((1, 3))

    def contains(self, points):
        return np.zeros(len(points), bool)


def test_a_solid_that_the_file_does_not_know_is_not_written(load, tmp_path):
    rig = load().through(Scene((Ring(),)))
    with pytest.raises(ValueError, match="solid ring: found Ring, expected one of window"):
        save_rig(rig, tmp_path / "new.yaml")


def ball(radius=5.0):
    shape = trimesh.creation.icosphere(subdivisions=2, radius=radius)
    shape.apply_translation([0, 0, 60])
    return shape


def opened(shape):
    return trimesh.Trimesh(shape.vertices, shape.faces[:-1], process=False)


def inverted(shape):
    return trimesh.Trimesh(shape.vertices, shape.faces[:, ::-1], process=False)


@pytest.mark.parametrize(
    ("change", "expected"),
    [(opened, "open edges"), (inverted, "normals inward")],
)
def test_glass_needs_a_closed_mesh_with_outward_normals(load, change, expected):
    change(ball()).export(load.folder / "part.stl")
    glass = MESH | {"material": "glass", "index": 1.5}
    with pytest.raises(ValueError, match=f"solid part: found .*{expected}"):
        load(glass)
    assert load(MESH).scene.solids[0].name == "part"  # hardware may be open
    ball().export(load.folder / "part.stl")
    assert load(glass).scene.solids[0].is_closed


@pytest.mark.parametrize("suffix", ["stl", "obj", "ply", "glb"])
def test_meshes_are_read_with_their_unit_and_place(load, suffix):
    shape = ball(0.005)
    shape.apply_translation([0, 0, -60])
    shape.export(load.folder / f"part.{suffix}")
    (found,) = load(MESH | {"file": f"part.{suffix}", "unit": "m", "t": [0, 0, 60]}).scene.solids
    radii = np.linalg.norm(found.vertices - [0, 0, 60], axis=1)
    np.testing.assert_allclose(radii, 5, atol=1e-5)


@pytest.mark.parametrize(
    "content", [b"", b"solid\nendsolid\n", b"\x00" * 84, b"PK\x03\x04rubbish"]
)
def test_files_without_a_mesh_are_refused(load, content):
    (load.folder / "part.stl").write_bytes(content)
    with pytest.raises(ValueError, match=r"solid part: part.stl: (not a mesh|found no triangle)"):
        load(MESH)


def test_a_mesh_too_large_is_refused_by_its_memory_before_it_is_read(load):
    with open(load.folder / "part.stl", "wb") as file:
        file.truncate(LARGEST * 100 + 1)  # takes no room on the disk
    with pytest.raises(ValueError, match=r"found 400 MB, expected at most .*simplify"):
        load(MESH)
    corners = np.zeros((3, 3))
    with pytest.raises(ValueError, match=r"triangles \(some .* GB\), expected at most"):
        Mesh("m", corners, np.broadcast_to(np.arange(3), (LARGEST + 1, 3)), Opaque())
    with pytest.raises(ValueError, match="found no triangle"):
        Mesh("m", corners, np.zeros((0, 3), int), Opaque())
