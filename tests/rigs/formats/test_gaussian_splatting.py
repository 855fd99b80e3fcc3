"""3-D Gaussian splatting's cameras, written here as ``camera_to_JSON`` does."""

import json

import numpy as np
import pytest

from rigs import formats


def entries(rig, names=None):
    found = []
    for index, camera in enumerate(rig):
        Rt = np.eye(4)
        Rt[:3, :3], Rt[:3, 3] = camera.R, camera.t
        to_world = np.linalg.inv(Rt)
        width, height = camera.image_size
        found.append(
            {
                "id": index,
                "img_name": (names or rig.names)[index],
                "width": width,
                "height": height,
                "position": to_world[:3, 3].tolist(),
                "rotation": to_world[:3, :3].tolist(),
                "fy": camera.camera_matrix[1, 1],
                "fx": camera.camera_matrix[0, 0],
            }
        )
    return found


def write(folder, data):
    path = folder / "cameras.json"
    path.write_text(json.dumps(data))
    return path


def by_rasteriser(points, entry):
    """Pixels as the renderer finds them: fields of view, a symmetric frustum, ``ndc2Pix``."""
    to_world = np.eye(4)
    to_world[:3, :3], to_world[:3, 3] = entry["rotation"], entry["position"]
    seen = (np.c_[points, np.ones(len(points))] @ np.linalg.inv(to_world).T)[:, :3]
    pixels = []
    for axis, (size, focal) in enumerate((("width", "fx"), ("height", "fy"))):
        tan_half = np.tan(np.arctan(entry[size] / (2 * entry[focal])))
        ndc = seen[:, axis] / (seen[:, 2] * tan_half)
        pixels.append(((ndc + 1.0) * entry[size] - 1.0) * 0.5)
    return np.stack(pixels, axis=1)


def test_cameras(make_rig, assert_projects, tmp_path):
    data = entries(make_rig("none", "none", "none"))
    path = write(tmp_path, data)
    assert formats.sniff(path) == "gaussian_splatting"
    rig = formats.load(path)
    assert rig.names == ("cam0", "cam1", "cam2")
    for camera, entry in zip(rig, data, strict=True):
        assert_projects(camera, lambda points, entry=entry: by_rasteriser(points, entry))


def test_moments_of_fixed_cameras(make_rig, tmp_path):
    rig = make_rig("none", "none")
    both = entries(rig, ["a_001", "b_001"]) + entries(rig, ["a_002", "b_002"])
    assert formats.load(write(tmp_path, both)).names == ("a", "b")


@pytest.mark.parametrize(
    ("path", "value", "message"),
    [
        ((0, "cx"), 320.0, "camera cam0: cx: found 320.0, expected none, as the format has no le"),
        ((0, "k1"), 0.1, "camera cam0: k1: found 0.1, expected none"),
        ((0, "rotation"), [[1]], "camera cam0: rotation: found [[1]], expected 3 x 3"),
        ((0, "img_name"), 7, "[0]: img_name: found 7, expected an image's name"),
    ],
)
def test_what_is_wrong_is_named(refused_as, make_rig, mutated, tmp_path, path, value, message):
    file = write(tmp_path, mutated(entries(make_rig("none", "none")), path, value))
    refused_as(file, message, file)
