"""openMVG's scenes, written here as cereal writes them, with the formulas of its cameras."""

import json
import re

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from rigs import formats, look_at
from rigs.formats import openmvg

LENSES = {
    "pinhole": {},
    "pinhole_radial_k1": {"disto_k1": [-0.1]},
    "pinhole_radial_k3": {"disto_k3": [-0.2, 0.08, 0.01]},
    "pinhole_brown_t2": {"disto_t2": [-0.2, 0.08, 0.01, 0.001, -0.002]},
    "fisheye": {"fisheye": [0.02, -0.01, 0.003, -0.001]},
}
CENTERS = ((10, 40, 300), (260, 30, 150), (-250, 60, 170), (90, -80, 200), (0, 210, 90))


def scene(kinds=tuple(LENSES), nested=False, folders=False):
    """A scene with one view of each lens; every view is the second of its lens but the first."""
    views, intrinsics, extrinsics = [], [], []
    for index, kind in enumerate(kinds):
        R, _ = look_at(CENTERS[index], (0, 0, 0))
        name = f"cam{index}"
        data = {"local_path": name if folders else "", "filename": f"{name}.jpg", "width": 640,
                "height": 480, "id_view": index, "id_intrinsic": index,
                "id_pose": index}  # fmt: skip
        pointer = {"polymorphic_id": 1073741824, "ptr_wrapper": {"id": index, "data": data}}
        views.append({"key": index, "value": pointer})
        base = {"width": 640, "height": 480, "focal_length": 803.5 + index,
                "principal_point": [321.3, 238.4]}  # fmt: skip
        data = {"value0": base, **LENSES[kind]} if nested else {**base, **LENSES[kind]}
        number = 1 + sorted(LENSES).index(kind)
        is_first = kind not in kinds[:index]
        pointer = {"polymorphic_id": number + (2**31 if is_first else 0)}
        pointer |= {"polymorphic_name": kind} if is_first else {}
        pointer["ptr_wrapper"] = {"id": 2**31 + 50 + index, "data": data}
        intrinsics.append({"key": index, "value": pointer})
        pose = {"rotation": R.tolist(), "center": list(CENTERS[index])}
        extrinsics.append({"key": index, "value": pose})
    return {"sfm_data_version": "0.3", "root_path": "/data/images", "views": views,
            "intrinsics": intrinsics, "extrinsics": extrinsics, "structure": [],
            "control_points": []}  # fmt: skip


def pixels(points, data, index):
    """Pixels of points by openMVG's classes: ``cam2ima(add_disto(project(pose(X))))``."""
    pose = data["extrinsics"][index]["value"]
    lens = data["intrinsics"][index]["value"]["ptr_wrapper"]["data"]
    lens = {**lens.get("value0", {}), **lens}
    x, y, z = np.array(pose["rotation"]) @ (points - pose["center"]).T
    p = np.stack([x / z, y / z])
    q = (p**2).sum(axis=0)
    if "disto_k1" in lens or "disto_k3" in lens:
        k = (*lens.get("disto_k3", lens.get("disto_k1")), 0.0, 0.0)
        p = p * (1 + k[0] * q + k[1] * q**2 + k[2] * q**3)
    elif "disto_t2" in lens:
        k1, k2, k3, t1, t2 = lens["disto_t2"]
        shift = [t2 * (q + 2 * p[0] ** 2) + 2 * t1 * p[0] * p[1],
                 t1 * (q + 2 * p[1] ** 2) + 2 * t2 * p[0] * p[1]]  # fmt: skip
        p = p * (1 + k1 * q + k2 * q**2 + k3 * q**3) + shift
    elif "fisheye" in lens:
        r = np.sqrt(q)
        a = np.arctan(r)
        k1, k2, k3, k4 = lens["fisheye"]
        p = p * (a + k1 * a**3 + k2 * a**5 + k3 * a**7 + k4 * a**9) / r
    return lens["focal_length"] * p.T + lens["principal_point"]


def write(folder, data):
    path = folder / "sfm_data.json"
    path.write_text(json.dumps(data, indent=1))
    return path


@pytest.mark.parametrize("nested", [False, True])
def test_every_lens(assert_projects, tmp_path, nested):
    data = scene(nested=nested)
    path = write(tmp_path, data)
    assert formats.sniff(path) == "openmvg"
    rig = formats.load(path)
    assert rig.names == tuple(f"cam{i}" for i in range(5))
    for index, camera in enumerate(rig):
        assert_projects(camera, lambda points, i=index: pixels(points, data, i))


def test_a_type_is_named_once(tmp_path):
    kinds = ("fisheye", "pinhole_radial_k3", "fisheye")
    rig = formats.load(write(tmp_path, scene(kinds, folders=True)))
    assert [camera.distortion.model for camera in rig] == ["fisheye", "brown", "fisheye"]


def test_views_without_a_pose_are_named(tmp_path, caplog):
    data = scene()
    del data["extrinsics"][1]
    assert formats.load(write(tmp_path, data)).names == ("cam0", "cam2", "cam3", "cam4")
    assert "left out 1 views without a pose: 'cam1.jpg'" in caplog.text
    data["extrinsics"] = []
    with pytest.raises(ValueError, match="extrinsics: found a pose of none of 5 views, expected"):
        formats.load(write(tmp_path, data))


VIEW = ("value", "ptr_wrapper", "data")


@pytest.mark.parametrize(
    ("path", "value", "message"),
    [
        (("intrinsics",), None, "intrinsics: missing"),
        (("intrinsics", 0, "value", "polymorphic_name"), "spherical",
         "intrinsics 0: polymorphic_name: found 'spherical', expected one of pinhole, "),
        (("intrinsics", 1, *VIEW, "disto_k1"), [1, 2], "intrinsics 1: disto_k1: found [1, 2]"),
        (("intrinsics", 1, *VIEW, "disto_k1"), None, "intrinsics 1: disto_k1: missing"),
        (("intrinsics", 1, *VIEW, "width"), 0, "intrinsics 1: width: found 0, expected a whole"),
        (("intrinsics", 1, "value"), 3, "intrinsics 1: value: found 3, expected a mapping"),
        (("extrinsics", 0, "value", "center"), [1], "view cam0.jpg: center: found [1], exp"),
        (("extrinsics", 0, "value", "rotation"), None, "view cam0.jpg: rotation: missing"),
        (("views", 0, *VIEW, "id_intrinsic"), 77, "view cam0.jpg: id_intrinsic: found 77"),
        (("views", 0, *VIEW, "id_pose"), [0], "view cam0.jpg: id_pose: found [0], exp"),
        (("views", 0, "key"), "a", "views[0]: key: found 'a', expected a whole number"),
    ],
)  # fmt: skip
def test_what_is_wrong_is_named(mutated, tmp_path, path, value, message):
    file = write(tmp_path, mutated(scene(), path, value))
    with pytest.raises(ValueError, match=re.escape(f"{file}: {message}")):
        formats.load(file)


@given(data=st.data())
@settings(suppress_health_check=[HealthCheck.function_scoped_fixture], max_examples=35)
def test_broken_files_are_refused_or_read(read_or_refused, damaged, tmp_path, data):
    file = tmp_path / "sfm_data.json"
    file.write_text(damaged(json.dumps(scene()), data))
    rig = read_or_refused(openmvg.load, file)
    assert rig is None or len(rig)
