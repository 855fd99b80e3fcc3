"""Every kind of bad file, through the commands: one line, exit code 2, nothing half-written."""

import json
import re
from pathlib import Path

import numpy as np
import pytest
import tifffile

from rigs import load_rig
from tomo import load_scan, reconstruct

QUICK = ("--method", "sirt", "--iterations", "2")
BOX = ("--grid", "6x10x6", "--spacing", "1")


def _image(scan, camera="cam01"):
    return scan / "images" / camera / "frame_000.tif"


CAMERA_FAULTS = {
    "model": (
        {"distortion": {"model": "foo", "coefficients": []}},
        "distortion.model: found 'foo', expected one of none, brown",
    ),
    "count": (
        {"distortion": {"model": "brown", "coefficients": [1, 2, 3]}},
        "distortion.coefficients: found 3 for model brown, expected 4 or 5",
    ),
    "mirrored": ({"R": [[-1, 0, 0], [0, 1, 0], [0, 0, 1]]}, "R: mirrored"),
    "skewed": ({"R": [[1, 0.1, 0], [0, 1, 0], [0, 0, 1]]}, "R: not orthonormal"),
}


@pytest.mark.parametrize("tool", ["reconstruct", "simulate", "visualize_rig"])
@pytest.mark.parametrize("fault", CAMERA_FAULTS)
def test_a_wrong_camera(refused, edit, scan, tmp_path, tool, fault):
    fields, words = CAMERA_FAULTS[fault]
    edit(scan / "rig.yaml", lambda rig: rig["cameras"][1].update(fields))
    arguments = {
        "reconstruct": (scan, "-o", tmp_path / "out"),
        "simulate": ("--rig", scan / "rig.yaml", "--phantom", "jet", "-o", tmp_path / "out"),
        "visualize_rig": (scan, "-o", tmp_path / "out.png"),
    }[tool]
    assert f"{scan / 'rig.yaml'}: camera cam01: {words}" in refused(tool, *arguments)


def _replace_image(pixels, **settings):
    return lambda path: tifffile.imwrite(path, pixels, **settings)


def _overwrite(value):
    def overwrite(path):
        pixels = tifffile.imread(path)
        pixels[3, 4] = value
        tifffile.imwrite(path, pixels)

    return overwrite


def _cut(count):
    return lambda path: path.write_bytes(path.read_bytes()[:count])


IMAGE_FAULTS = {
    "missing": (Path.unlink, "no such image file"),
    "size": (
        _replace_image(np.zeros((18, 13), np.float32)),
        "found an image of 13 x 18 pixels, expected 12 x 18",
    ),
    "colour": (
        _replace_image(np.indices((18, 12, 3))[2].astype(np.uint8), photometric="rgb"),
        "found a colour image",
    ),
    "NaN": (_overwrite(np.nan), "found 1 NaN or infinite pixels, the first at row 3, column 4"),
    "infinite": (_overwrite(-np.inf), "found 1 NaN or infinite pixels"),
    "empty": (_cut(0), "not a readable image: the file is empty"),
    "header only": (_cut(6), "not a readable image"),
    "directory cut": (_cut(100), "not a readable image"),
    "pixels cut": (_cut(-50), "truncated"),
}


@pytest.mark.parametrize("fault", IMAGE_FAULTS)
def test_a_wrong_image(refused, scan, tmp_path, fault):
    overwrite, words = IMAGE_FAULTS[fault]
    overwrite(_image(scan))
    # a held-out camera's image is read and checked as well
    for options in ((), ("--hold-out", "cam01")):
        line = refused("reconstruct", scan, *options, "-o", tmp_path / "out")
        assert words in line
        assert str(_image(scan)) in line
        assert "camera cam01" in line


SCAN_FAULTS = {
    "no image": (
        lambda d: d["frames"][0]["images"].pop("cam01"),
        "frame 'frame_000': camera cam01: found no image",
    ),
    "unknown camera": (
        lambda d: d["frames"][0]["images"].update(cam99="x.tif"),
        "frame 'frame_000': found camera 'cam99', expected one of the rig's: cam00, cam01",
    ),
    "image outside": (
        lambda d: d["frames"][0]["images"].update(cam01="../x.tif"),
        "frame 'frame_000': camera cam01: found '../x.tif', expected a path inside",
    ),
    "rig outside": (
        lambda d: d.update(rig="/rig.yaml"),
        "rig: found '/rig.yaml', expected a path",
    ),
    "negative gain": (
        lambda d: d.update(effects={"gains": {"cam01": -1.0}}),
        "effects.gains.cam01: found -1, expected a number above 0",
    ),
    "truth outside": (lambda d: d.update(truth="../t.npz"), "truth: found '../t.npz'"),
}


@pytest.mark.parametrize("fault", SCAN_FAULTS)
def test_a_wrong_scan_file(refused, edit, scan, tmp_path, fault):
    change, words = SCAN_FAULTS[fault]
    edit(scan / "scan.yaml", change)
    line = refused("reconstruct", scan, "-o", tmp_path / "out")
    assert f"{scan / 'scan.yaml'}: {words}" in line


def test_a_camera_missing_from_the_rig(refused, edit, scan, tmp_path):
    edit(scan / "rig.yaml", lambda rig: rig["cameras"].pop(1))
    line = refused("reconstruct", scan, "-o", tmp_path / "out")
    assert "found camera 'cam01', expected one of the rig's: cam00, cam02" in line


@pytest.mark.parametrize("fraction", [0, 0.3, 0.6, 0.85])
@pytest.mark.parametrize("name", ["scan.yaml", "rig.yaml", "truth.npz", "transforms.json"])
def test_empty_and_truncated_files(refused, scan, tmp_path, name, fraction):
    if name == "transforms.json":
        (scan / name).write_text(json.dumps(_transforms(load_rig(scan / "rig.yaml"))))
    path = scan / name
    path.write_bytes(path.read_bytes()[: int(fraction * path.stat().st_size)])
    given = path if name == "transforms.json" else scan
    line = refused("reconstruct", given, "-o", tmp_path / "out")
    # a scan.yaml may end anywhere and still be YAML: then the missing part is named
    assert str(path) in line or name == "scan.yaml"
    if name == "transforms.json":
        assert str(path) in refused("visualize_rig", path, "-o", tmp_path / "o.png")
    if name == "truth.npz":
        assert str(path) in refused("visualize_volume", path, "-o", tmp_path / "o.html")
        result = refused("visualize_rig", scan, "--volume", path, "-o", tmp_path / "o.glb")
        assert str(path) in result


def _transforms(rig, suffix=".tif"):
    frames = []
    for camera in rig:
        pose = np.eye(4)
        pose[:3, :3] = (np.diag([1, -1, -1]) @ camera.R).T
        pose[:3, 3] = camera.position
        K, (width, height) = camera.camera_matrix, camera.image_size
        frames.append(
            {
                "file_path": f"images/{camera.name}/frame_000{suffix}",
                "transform_matrix": pose.tolist(),
                "w": width,
                "h": height,
                "fl_x": K[0, 0],
                "fl_y": K[1, 1],
                "cx": K[0, 2] + 0.5,
                "cy": K[1, 2] + 0.5,
            }
        )
    return {"camera_model": "PINHOLE", "length_unit": "mm", "frames": frames}


@pytest.mark.parametrize(
    ("fields", "words"),
    [
        ({"file_path": "../x.tif"}, "file_path: found '../x.tif', expected a path inside"),
        ({"camera_model": "FOO"}, "camera_model: found 'FOO', expected one of"),
        ({"transform_matrix": np.diag([-1, 1, 1, 1]).tolist()}, "transform_matrix: mirrored"),
        ({"w": 13}, "camera cam01: found an image of 12 x 18 pixels, expected 13 x 18"),
        ({"k1": "a"}, "k1: found 'a'"),
    ],
)
def test_a_wrong_entry_of_transforms(refused, scan, tmp_path, fields, words):
    data = _transforms(load_rig(scan / "rig.yaml"))
    data["frames"][1].update(fields)
    (scan / "transforms.json").write_text(json.dumps(data))
    box = ("--grid", "6x10x6", "--spacing", "1")
    line = refused("reconstruct", scan / "transforms.json", *box, "-o", tmp_path / "out")
    assert words in line
    assert str(scan) in line


def _write_encoder(path, inputs):
    from tomo.wernet import Encoder, save_encoder

    save_encoder(Encoder(inputs), path)


ENCODER_FAULTS = {
    "missing": ("wernet", None, "no such file, expected an encoder"),
    "missing, paper": ("wernet-paper", None, "no such file, expected an encoder"),
    "text": ("wernet", "text", "found a file that cannot be read"),
    "inputs": ("wernet", "relative", "encoder: found one that sees 'relative' inputs, expected"),
    "inputs, paper": ("wernet-paper", "optics", "encoder: found one that sees 'optics' inputs"),
}


@pytest.mark.parametrize("fault", ENCODER_FAULTS)
def test_a_wrong_encoder(scan, tmp_path, fault):
    method, content, words = ENCODER_FAULTS[fault]
    path = tmp_path / "encoder.pt"
    if content == "text":
        path.write_text("no encoder")
    elif content is not None:
        _write_encoder(path, content)
    how = tmp_path / "how.yaml"
    how.write_text("encoder: encoder.pt\n")
    with pytest.raises((ValueError, FileNotFoundError), match=re.escape(f"{path}: {words}")):
        reconstruct(load_scan(scan), method=method, wernet_settings=str(how))


@pytest.mark.parametrize("content", [b"", b"no checkpoint"])
def test_a_wrong_checkpoint(scan, tmp_path, content):
    kept, how = tmp_path / "checkpoint.pt", tmp_path / "how.yaml"
    kept.write_bytes(content)
    how.write_text("checkpoint: checkpoint.pt\nresume: true\n")
    with pytest.raises(ValueError, match=re.escape(f"{kept}: found a file that cannot be read")):
        reconstruct(load_scan(scan), method="wernet-paper", wernet_settings=str(how))


@pytest.mark.parametrize("tool", ["reconstruct", "simulate"])
def test_a_unit_that_volume_files_cannot_hold(refused, edit, scan, tmp_path, tool):
    edit(scan / "rig.yaml", lambda rig: rig.update(length_unit="my unit"))
    arguments = {
        "reconstruct": (scan,),
        "simulate": ("--rig", scan / "rig.yaml", "--phantom", "jet", *BOX),
    }[tool]
    line = refused(tool, *arguments, "-o", tmp_path / "out")
    assert "length_unit: found 'my unit', expected one word" in line


def test_an_earlier_output_survives_bad_input(refused, scan, tmp_path):
    out = tmp_path / "out"
    out.mkdir()
    for name in ("report.json", "report.html", "volume.npz", "difference.png"):
        (out / name).write_text(f"an earlier {name}")
    _overwrite(np.nan)(_image(scan))
    refused("reconstruct", scan, *QUICK, "-o", out)  # compares every file below tmp_path
    refused("reconstruct", scan, "--center", "1e7,0,0", "-o", out)
