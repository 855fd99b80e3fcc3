"""Multical's files, written here by its documented layout."""

import json

import pytest

from rigs import formats


def multical_data(rig, master=None):
    models = {"none": "standard", "brown": "standard"}
    cameras = {
        camera.name: {
            "model": models.get(camera.distortion.model, camera.distortion.model),
            "image_size": list(camera.image_size),
            "K": camera.camera_matrix.tolist(),
            "dist": [list(camera.distortion.coefficients) or [0.0] * 5],
        }
        for camera in rig
    }
    poses = {
        c.name if master in (None, c.name) else f"{c.name}_to_{master}": {
            "R": c.R.tolist(),
            "T": c.t.tolist(),
        }
        for c in rig
    }
    return {"cameras": cameras, "camera_poses": poses, "image_sets": {"rgb": []}}


@pytest.mark.parametrize("master", [None, "cam0"])
def test_multical(make_rig, assert_same_views, tmp_path, master):
    rig = make_rig("brown", "rational", "tilted")
    path = tmp_path / "calibration.json"
    path.write_text(json.dumps(multical_data(rig, master)))
    assert formats.sniff(path) == "multical"
    assert_same_views(formats.load(path), rig)


@pytest.mark.parametrize(
    ("path", "value", "message"),
    [
        (("camera_poses",), None, "camera_poses: missing"),
        (("camera_poses", "cam1"), None, "camera cam1: camera_poses: missing"),
        (("camera_poses", "cam1", "R"), None, "camera cam1: R: missing"),
        (("cameras", "cam0", "model"), "omni", "camera cam0: model: found 'omni', expected one o"),
        (("cameras", "cam0", "dist"), [1, 2], "camera cam0: dist: found 2 coefficients"),
        (("cameras", "cam0"), 3, "camera cam0: entry: found 3, expected a mapping"),
    ],
)
def test_what_is_wrong_in_multicals_files_is_named(
    refused_as, make_rig, mutated, tmp_path, path, value, message
):
    file = tmp_path / "calibration.json"
    file.write_text(json.dumps(mutated(multical_data(make_rig("brown", "none")), path, value)))
    refused_as(file, message, file, "multical")
