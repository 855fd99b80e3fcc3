"""EasyMocap's two files, written here as its own writer does."""

import json

import cv2
import numpy as np
import pytest
import yaml

from rigs import formats


def storage_text(fields):
    """The text that EasyMocap writes: matrices by hand, lines ended as on Windows."""
    lines = ["%YAML:1.0", "---"]
    for key, value in fields.items():
        if isinstance(value, list) and key == "names":
            lines += ["names:", *(f'  - "{name}"' for name in value)]
        elif np.ndim(value) == 0:
            lines.append(f"{key}: {value}")
        else:
            rows, columns = np.shape(value)
            numbers = ", ".join(repr(float(n)) for n in np.ravel(value))
            lines += [f"{key}: !!opencv-matrix", f"  rows: {rows}", f"  cols: {columns}"]
            lines += ["  dt: d", f"  data: [{numbers}]"]
    return "\r\n".join(lines) + "\r\n"


def halves(rig, sizes=True, names=True):
    intri = {"names": list(rig.names)} if names else {}
    extri = dict(intri)
    for camera in rig:
        name = camera.name
        intri[f"K_{name}"] = camera.camera_matrix
        intri[f"dist_{name}"] = [camera.distortion.coefficients or (0.0,) * 5]
        if sizes:
            intri[f"W_{name}"], intri[f"H_{name}"] = camera.image_size
        extri[f"R_{name}"] = cv2.Rodrigues(np.array(camera.R))[0]
        extri[f"Rot_{name}"] = camera.R
        extri[f"T_{name}"] = camera.t.reshape(3, 1)
    return intri, extri


def write(folder, *parts, names=("intri.yml", "extri.yml")):
    for name, part in zip(names, parts, strict=True):
        (folder / name).write_text(storage_text(part), newline="")


@pytest.mark.parametrize("given_path", ["", "intri.yml", "extri.yml"])
@pytest.mark.parametrize("names", [True, False])
def test_both_files_are_one_rig(make_rig, assert_projects, tmp_path, given_path, names):
    rig = make_rig("brown", "rational", "none")
    write(tmp_path, *halves(rig, names=names))
    assert formats.sniff(tmp_path / given_path) == "easymocap"
    found = formats.load(tmp_path / given_path)
    assert found.names == rig.names
    assert found.length_unit == "unit"
    for camera, truth in zip(found, rig, strict=True):
        K, D = truth.camera_matrix, np.array(truth.distortion.coefficients or [0.0] * 5)
        lens = cv2.Rodrigues(np.array(truth.R))[0], np.array(truth.t), np.array(K), D

        def by_opencv(points, lens=lens):
            return cv2.projectPoints(points, *lens)[0][:, 0]

        assert camera.image_size == (640, 480)
        assert_projects(camera, by_opencv)


def test_one_file_of_both_halves_in_any_notation(make_rig, assert_same_views, tmp_path):
    rig = make_rig("brown", "none")
    both = {key: np.asarray(value).tolist() for half in halves(rig) for key, value in half.items()}
    (tmp_path / "a.json").write_text(json.dumps(both))
    (tmp_path / "a.yaml").write_text(yaml.safe_dump(both))
    storage = cv2.FileStorage(str(tmp_path / "a.xml"), cv2.FILE_STORAGE_WRITE)
    for half in halves(rig, names=False):
        for key, value in half.items():
            storage.write(key, value if np.ndim(value) == 0 else np.array(value))
    storage.release()
    for name in ("a.json", "a.yaml", "a.xml"):
        assert formats.sniff(tmp_path / name) == "easymocap"
        assert_same_views(formats.load(tmp_path / name), rig)


def test_an_image_size_is_asked_for(make_rig, tmp_path):
    write(tmp_path, *halves(make_rig("brown"), sizes=False))
    with pytest.raises(ValueError, match=r"camera cam0: image_size: missing.*--image-size"):
        formats.load(tmp_path)
    assert formats.load(tmp_path, image_size=(640, 480))[0].image_size == (640, 480)


def test_intrinsics_alone_stand_at_the_origin(make_rig, tmp_path, caplog):
    write(tmp_path, halves(make_rig("brown"))[0], names=("intri.yml",))
    camera = formats.load(tmp_path / "intri.yml")[0]
    assert camera.status == "nominal"
    assert "no poses" in caplog.text


def changed(half, **fields):
    """A half with other fields; None removes one."""
    return {k: v for k, v in {**half, **fields}.items() if v is not None}


@pytest.mark.parametrize(
    ("half", "fields", "message"),
    [
        (0, {"names": 3}, "names: found 3, expected a list of the cameras"),
        (0, {"dist_cam1": None}, "camera cam1: dist_cam1: missing, expected 4 or more"),
        (0, {"dist_cam0": [[1.0, 2.0]]}, "camera cam0: dist_cam0: found 2 coefficients"),
        (0, {"H_cam1": None}, "camera cam1: H_cam1: found nothing, expected a finite"),
        (1, {"R_cam1": None, "Rot_cam1": None}, "camera cam1: R_cam1: missing"),
        (1, {"Rot_cam0": np.eye(3)}, "camera cam0: Rot_cam0: found another rotation than R_cam0"),
    ],
)
def test_what_is_wrong_is_named(refused_as, make_rig, tmp_path, half, fields, message):
    parts = list(halves(make_rig("brown", "none")))
    parts[half] = changed(parts[half], **fields)
    write(tmp_path, *parts)
    file = tmp_path / "intri.yml"
    refused_as(file, message, file)
