"""Formats that are only written: pixels found again by the formulas of their programs."""

import json
import math
import re
import xml.etree.ElementTree as ElementTree
from dataclasses import replace

import numpy as np
import pytest

from rigs import Camera, RayTable, Rig, Volume, arc, formats


@pytest.fixture
def rig():
    cameras = arc(
        4, 160.0, 500.0, pitch_degrees=20.0, image_size=(64, 48), footprint=0.5
    ).transformed(np.eye(3), [3.0, -4.0, 5.0])
    matrices = [
        [[900 + 30 * i, 0, 31 + i], [0, 1.02 * (900 + 30 * i), 22 - i], [0, 0, 1]]
        for i in range(len(cameras))
    ]
    return Rig(
        tuple(
            Camera(c.name, c.image_size, K, R=c.R, t=c.t)
            for c, K in zip(cameras, matrices, strict=True)
        ),
        "mm",
        volume=Volume((10, 10, 10), 1.0, (3.0, -4.0, 5.0)),
    )


def points_of(camera):
    uv = np.random.default_rng(0).uniform(0, 1, (200, 2)) * camera.image_size
    origins, directions = camera.rays(uv)
    return uv, origins + directions * np.linspace(300, 700, 200)[:, None]


def test_astra_sees_the_same_pixels(rig, tmp_path):
    skewed = Camera("skewed", (64, 48), [[900, 7, 30], [0, 800, 20], [0, 0, 1]], t=[0, 0, 400])
    rig = Rig((*rig.cameras, skewed), "mm", volume=rig.volume)
    formats.save(rig, tmp_path / "geometry.astra.json")
    data = json.loads((tmp_path / "geometry.astra.json").read_text())
    assert data["type"] == "cone_vec"
    assert (data["DetectorRowCount"], data["DetectorColCount"]) == (48, 64)
    for camera, vector in zip(rig, data["Vectors"], strict=True):
        source, d, u, v = np.reshape(vector, (4, 3))
        uv, points = points_of(camera)
        # source + s (point - source) = d + a u + b v, for s, a and b
        for pixel, point in zip(uv, points, strict=True):
            s, a, b = np.linalg.solve(np.stack([source - point, u, v], axis=1), source - d)
            assert s > 0
            np.testing.assert_allclose([a + 31.5, b + 23.5], pixel, atol=1e-6)


def rtk_matrix(values):
    """RTK's matrix of its nine parameters, as ThreeDCircularProjectionGeometry composes it."""
    o, g, i = (-math.radians(values[f"{n}Angle"]) for n in ("OutOfPlane", "Gantry", "InPlane"))
    Rx = [[1, 0, 0], [0, math.cos(o), -math.sin(o)], [0, math.sin(o), math.cos(o)]]
    Ry = [[math.cos(g), 0, math.sin(g)], [0, 1, 0], [-math.sin(g), 0, math.cos(g)]]
    Rz = [[math.cos(i), -math.sin(i), 0], [math.sin(i), math.cos(i), 0], [0, 0, 1]]
    turn = np.eye(4)
    turn[:3, :3] = np.array(Rz) @ Rx @ Ry
    sx, sy = values["SourceOffsetX"], values["SourceOffsetY"]
    to_source = np.eye(4)
    to_source[:2, 3] = -sx, -sy
    sdd, sid = values["SourceToDetectorDistance"], values["SourceToIsocenterDistance"]
    magnify = np.array([[-sdd, 0, 0, 0], [0, -sdd, 0, 0], [0, 0, 1, -sid]])
    back = np.eye(3)
    back[:2, 2] = sx - values["ProjectionOffsetX"], sy - values["ProjectionOffsetY"]
    return back @ magnify @ to_source @ turn


def check_rtk(camera, projection):
    values = {child.tag: float(child.text) for child in projection if child.tag != "Matrix"}
    matrix = np.array(projection.find("Matrix").text.split(), float).reshape(3, 4)
    np.testing.assert_allclose(matrix, rtk_matrix(values), atol=1e-8)
    uv, points = points_of(camera)
    image = matrix @ np.concatenate([points, np.ones((200, 1))], axis=1).T
    spacing = camera.camera_matrix[0, 0] / camera.camera_matrix[1, 1]
    u, v = image[:2] / image[2]
    rows = camera.image_size[1]
    np.testing.assert_allclose(np.stack([u, rows - 1 - v / spacing], axis=1), uv, atol=1e-6)


def test_rtk_sees_the_same_pixels(rig, tmp_path):
    formats.save(rig, tmp_path / "geometry.xml")
    root = ElementTree.parse(tmp_path / "geometry.xml").getroot()
    assert (root.tag, root.get("version")) == ("RTKThreeDCircularGeometry", "3")
    for camera, projection in zip(rig, root.findall("Projection"), strict=True):
        check_rtk(camera, projection)


def test_rtk_has_a_file_a_camera_in_a_folder(make_rig, tmp_path):
    rig = make_rig("none", "none", "none")  # of different fx / fy
    with pytest.raises(ValueError, match=r"camera cam1: camera_matrix: found fx / fy = "):
        formats.save(rig, tmp_path / "geometry.xml")
    formats.save(rig, tmp_path / "geometries", "rtk")
    for camera in rig:
        root = ElementTree.parse(tmp_path / "geometries" / f"{camera.name}.xml").getroot()
        check_rtk(camera, root.find("Projection"))


@pytest.mark.parametrize("up", [1.0, -1.0])
def test_rtk_of_a_camera_that_looks_straight_down(tmp_path, up):
    K = [[900, 0, 31.5], [0, 900, 23.5], [0, 0, 1]]
    R = np.array([[0.6, 0.0, 0.8], [-0.8 * up, 0.0, 0.6 * up], [0.0, -up, 0.0]])
    camera = Camera("down", (64, 48), K, R=R, t=[1.0, 2.0, 400.0])
    formats.save(Rig((camera,)), tmp_path / "geometry.xml")
    root = ElementTree.parse(tmp_path / "geometry.xml").getroot()
    check_rtk(camera, root.find("Projection"))


@pytest.mark.parametrize("name", ["geometry.astra.json", "geometry.xml"])
def test_what_they_lack_is_refused(make_rig, tmp_path, name):
    with pytest.raises(ValueError, match="camera cam1: distortion: found model brown") as error:
        formats.save(make_rig("none", "brown"), tmp_path / name)
    assert str(error.value).startswith(f"{tmp_path / name}: ")
    a, b = make_rig("none", "none").cameras
    small = Rig((a, b.scaled(0.5)))
    message = "camera cam1: image_size: found (320, 240), expected (640, 480)"
    with pytest.raises(ValueError, match=re.escape(message)):
        formats.save(small, tmp_path / name)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("name", formats.names(writable=True))
def test_tables_of_rays_are_written_by_our_own_format_alone(make_rig, tmp_path, name):
    rig = make_rig("none", "none")
    rig = Rig((rig[0], RayTable.of(rig[1].scaled(0.05))))
    if name == "emission_rig":
        formats.save(rig, tmp_path / "rig.yaml", name)
        scaled = formats.load(tmp_path / "rig.yaml", length_unit="mm")
        assert isinstance(scaled["cam1"], RayTable)
        return
    with pytest.raises(ValueError, match="camera cam1: ray_table: found a table of rays, which"):
        formats.save(rig, tmp_path / "rig", name)
    assert list(tmp_path.iterdir()) == []


def test_lengths_of_tables_are_converted(tmp_path):
    table = RayTable("a", [1.0, 2.0, 3.0], np.ones((3, 4, 3)))
    formats.save(Rig((table,), "m"), tmp_path / "rig.yaml")
    found = formats.load(tmp_path / "rig.yaml", length_unit="mm")["a"]
    np.testing.assert_array_equal(found.origins[1, 1], [1000, 2000, 3000])
    np.testing.assert_array_equal(found.directions, table.directions)


def test_rtk_files_are_xml_whatever_the_names(make_rig, tmp_path):
    camera = make_rig("none")[0]
    rig = Rig(tuple(replace(camera, name=name) for name in ("a---b", "c--", "d<&e")))
    formats.save(rig, tmp_path / "geometry.xml")
    assert len(ElementTree.parse(tmp_path / "geometry.xml").findall("Projection")) == 3
