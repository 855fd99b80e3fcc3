import json
import re
import struct

import matplotlib.image
import numpy as np
import pytest
import trimesh

from rigs import Camera, Rig, look_at
from tomo.draw import Mesh, Scene, write_glb, write_html
from tomo.draw.figures import save_figure
from tomo.draw.rig.rig_picture import draw_rig
from tomo.draw.rig.rig_scene import rig_scene
from tomo.draw.stage import Shown
from tomo.draw.volume.isosurface import isosurface_scene
from tomo.grid import Volume, VoxelGrid

GRID = VoxelGrid((6, 14, 8), (0.5, 1.0, 0.75), (1.0, 2.0, 3.0))
pytestmark = pytest.mark.usefixtures("coarse_scenes")

HOSTILE = "<img src=x onerror=alert(1)> $x^$"


def rig_of(*names, distance=100.0):
    cameras = []
    for i, name in enumerate(names):
        angle = 2 * np.pi * i / len(names)
        position = np.add(GRID.center, [distance * np.sin(angle), 0, distance * np.cos(angle)])
        R, t = look_at(position, GRID.center)
        matrix = [[600, 0, 31.5], [0, 600, 47.5], [0, 0, 1]]
        cameras.append(Camera(name, (64, 96), matrix, R=R, t=t))
    return Rig(tuple(cameras))


@pytest.fixture(scope="module")
def volume():
    values = np.exp(-((GRID.centers() - GRID.center) ** 2).sum(axis=-1) / 4)
    return Volume(values.astype(np.float32), GRID)


def loads(page):
    """Return what an HTML page makes a browser fetch."""
    tags = re.findall(r"<(?:script|link|img|iframe|source|object)\b[^>]*>", page)
    return [t for t in tags if re.search(r"""\s(?:src|href|data)\s*=\s*(?!["']?data:)""", t)]


def test_glb_is_the_scene_in_metres(tmp_path, volume):
    scene = rig_scene(rig_of("a", "b", "c"), GRID) + isosurface_scene(volume)
    write_glb(tmp_path / "rig.glb", scene)
    loaded = trimesh.load(tmp_path / "rig.glb")
    np.testing.assert_allclose(loaded.bounds, scene.without("stems").bounds / 1000, atol=1e-6)
    box = loaded.geometry["box/volume box"]
    np.testing.assert_allclose(box.bounds, scene.only(["box"]).bounds, atol=1e-4)
    assert {"cameras/a", "cameras/b", "cameras/c"} <= set(loaded.graph.nodes_geometry)
    outer = loaded.geometry["isosurface 15%/15% of the maximum"]
    assert outer.visual.material.alphaMode == "BLEND"


def normals_in(path):
    """Return the normals in a GLB as they are stored, ``(N, 3)``."""
    content = path.read_bytes()
    (length,) = struct.unpack("<I", content[12:16])
    tree, binary = json.loads(content[20 : 20 + length]), content[28 + length :]
    found = []
    for mesh in tree["meshes"]:
        accessor = tree["accessors"][mesh["primitives"][0]["attributes"]["NORMAL"]]
        view = tree["bufferViews"][accessor["bufferView"]]
        start = view.get("byteOffset", 0) + accessor.get("byteOffset", 0)
        found.append(np.frombuffer(binary, "<f4", 3 * accessor["count"], start).reshape(-1, 3))
    return np.concatenate(found)


def test_normals_in_a_glb_are_unit_vectors(tmp_path, volume):
    """As Khronos' validator asks; tips of arrows have no face with an area around them."""
    scene = rig_scene(rig_of("a", "b", "c"), GRID) + isosurface_scene(volume)
    needle = Mesh("needle", "odd", np.eye(3)[[0, 0, 1]], np.array([[0, 1, 2]]), (1, 0, 0))
    write_glb(tmp_path / "rig.glb", scene + Scene((needle,), (), scene.length_unit))
    lengths = np.linalg.norm(normals_in(tmp_path / "rig.glb"), axis=1)
    assert len(lengths) > 1000
    np.testing.assert_allclose(lengths, 1, atol=1e-6)


def test_html_names_the_cameras_and_loads_nothing(tmp_path, volume):
    rig = rig_of("left eye", "right eye")
    path = tmp_path / "rig.html"
    write_html(path, rig_scene(rig, GRID), title="my rig", shown=Shown((volume,)))
    page = path.read_text(encoding="utf-8")
    (data,) = re.findall(r'"application/json">(.*?)</script>', page, re.DOTALL)
    stage = json.loads(data)
    names = {label["text"] for label in stage["labels"] if label["layer"] == "names"}
    assert names == {"left eye", "right eye"}
    assert stage["unit"] == "mm"
    assert stage["volume"]["shape"] == list(GRID.shape)
    assert "<title>my rig</title>" in page
    assert loads(page) == []
    (policy,) = re.findall(r'Content-Security-Policy" content="(.*?)"', page)
    assert policy.startswith("default-src 'none'")
    assert "class Light" in page  # what draws is inside
    assert not re.search(r"\b(?:fetch|import|XMLHttpRequest|WebSocket|Worker)\s*\(", page)


def test_html_escapes_names(tmp_path):
    path = tmp_path / "rig.html"
    write_html(path, rig_scene(rig_of(HOSTILE), GRID), title="</title><script>alert(1)</script>")
    page = path.read_text(encoding="utf-8")
    assert [tag[:27] for tag in re.findall("<img[^>]*>", page)] == ['<img src="data:image/png;ba']
    assert "<script>alert" not in page
    (data,) = re.findall(r'"application/json">(.*?)</script>', page, re.DOTALL)
    assert HOSTILE in {label["text"] for label in json.loads(data)["labels"]}


def test_rig_png_has_its_size_and_content(tmp_path, volume):
    path = tmp_path / "rig.png"
    save_figure(draw_rig(rig_of(HOSTILE, "b"), volume=volume), path)
    picture = matplotlib.image.imread(path)[..., :3]
    assert picture.shape == (1200, 2200, 3)
    assert 0.01 < (picture.min(axis=2) < 0.9).mean() < 0.6
    assert [p.name for p in tmp_path.iterdir()] == ["rig.png"]


def test_no_two_names_overlap_in_the_picture():
    names = [f"camera{i:02d}" for i in range(30)]
    figure = draw_rig(rig_of(*names), GRID)
    overview = figure.axes[0]
    boxes = [t.get_window_extent() for t in overview.texts]
    written = {t.get_text() for t in overview.texts}
    assert len(written & set(names)) >= 28  # a name may be left out, not written over another
    for i, one in enumerate(boxes):
        assert not any(one.padded(-1).overlaps(other.padded(-1)) for other in boxes[:i])
