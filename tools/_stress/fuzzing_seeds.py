"""Small text files of every kind that is read, many made by the project's own writers."""

from __future__ import annotations

import json
from pathlib import Path

import cv2
import numpy as np
import yaml

EYE = [[1.0, 0, 0], [0, 1.0, 0], [0, 0, 1.0]]
K = [[80.0, 0, 4], [0, 80.0, 3], [0, 0, 1]]
LENSES = {
    "brown": [-0.2, 0.05, 0.001, -0.002],
    "rational": [0.4, -0.3, 0.001, -0.0005, 0.02, 0.6, -0.1, 0.01],
    "fisheye": [0.02, -0.01, 0.003, -0.001],
    "none": [],
}


def rig(*models: str):
    """Return a rig of one small camera for each lens named."""
    from rigs import Camera, Distortion, Rig, look_at

    cameras = []
    for number, model in enumerate(models):
        R, t = look_at([90.0 + 10 * number, 20, 30 - 40 * number], [0, 0, 0], [0, 1, 0])
        lens = Distortion(model, tuple(LENSES[model]))
        cameras.append(Camera(f"cam{number}", (9, 7), K, lens, R, t, status="calibrated"))
    return Rig(tuple(cameras), "mm", "somewhere")


def written(save, folder: Path, name: str) -> bytes:
    """Return what a writer writes."""
    save(folder / name)
    return (folder / name).read_bytes()


def short_rig() -> bytes:
    """Return a rig.yaml with everything that may be said in other ways."""
    return b"""format: emission-rig
version: 1
length_unit: mm
convention: opencv
cameras:
  - {name: left, image_size: [9, 7], position: [-30, 0, 50], look_at: [0, 0, 0], up: [0, 1, 0],
     focal_length: 25, pixel_pitch: [0.0074, 1e-3], principal_point: [4, 3],
     distortion: {model: none, coefficients: []}, status: virtual,
     optics: {focal_length: 25, f_number: 8, focus_distance: 300, pixel_pitch: 0.0074}}
volume: {shape: [3, 4, 5], spacing: 0.5, center: [0, 0, 0]}
calibration: {date: 2020-01-01, ray_miss: 0.01}
"""


def scan_yaml() -> bytes:
    """Return a scan.yaml with all corrections."""
    return b"""format: emission-scan
version: 1
rig: rig.yaml
grid: {shape: [3, 4, 5], spacing: 0.5, center: [0, 0, 0]}
frames:
  - {name: "0001", images: {cam0: a.tif}}
corrections:
  dark: 0.01
  flat: {cam0: a.tif}
  gain: {cam0: 1.02}
  mask: {cam0: a.tif}
  saturation: 0.98
  bit_depth: 12
truth: truth.npz
effects: {gain_spread: 0.1, absorption: 0.1, gains: {cam0: 1.0}}
"""


def kalibr(model: str) -> bytes:
    """Return a camchain.yaml of two cameras."""
    lens = {"pinhole": "radtan", "omni": "radtan"}.get(model, "none")
    first = {"pinhole": [], "omni": [0.8], "ds": [-0.2, 0.59], "eucm": [0.6, 1.1]}[model]
    camera = {
        "camera_model": model,
        "intrinsics": [*first, 8.0, 8.0, 4.0, 3.0],
        "distortion_model": lens,
        "distortion_coeffs": [0.0, 0.01, 0, 0] if lens == "radtan" else [],
        "resolution": [9, 7],
    }
    link = np.eye(4)
    link[0, 3] = 0.1
    other = camera | {"T_cn_cnm1": link.tolist()}
    other = json.loads(json.dumps(other))  # no aliases
    return yaml.safe_dump({"cam0": camera, "cam1": other}, default_flow_style=None).encode()


def multical() -> bytes:
    """Return a calibration.json."""
    camera = {"model": "standard", "image_size": [9, 7], "K": K, "dist": [[0.1, 0, 0, 0, 0]]}
    pose = {"R": EYE, "T": [0, 0, 1]}
    poses = {"a": pose, "b_to_a": pose}
    return json.dumps({"cameras": {"a": camera, "b": camera}, "camera_poses": poses}).encode()


def anipose() -> bytes:
    """Return a calibration.toml, two cameras in two styles."""
    rows = f"size = [9, 7]\nmatrix = {K}\ndistortions = [0.1, 0, 0, 0, 0]\n"
    pose = "translation = [0, 0, 1]\nfisheye = false\n"
    return (
        f'[cam_0]\nname = "a"\n{rows}rotation = [0.1, 0, 0]\n{pose}\n'
        f"[cam_1]\n{rows}rotation = {EYE}\n{pose}\n[metadata]\nadjusted = false\n"
    ).encode()


def stereo() -> tuple[bytes, bytes]:
    """Return stereo_calib's intrinsics.yml and extrinsics.yml."""
    texts = []
    for matrices in (
        {"M1": np.array(K), "D1": np.zeros((1, 5)), "M2": np.array(K), "D2": np.zeros((1, 5))},
        {"R": np.eye(3), "T": np.array([[1.0], [0], [0]])},
    ):
        flags = cv2.FILE_STORAGE_WRITE | cv2.FILE_STORAGE_MEMORY | cv2.FILE_STORAGE_FORMAT_YAML
        storage = cv2.FileStorage("a.yml", flags)
        for name, matrix in matrices.items():
            storage.write(name, matrix)
        texts.append(storage.releaseAndGetString().encode())
    return texts[0], texts[1]


def openptv() -> dict[str, bytes]:
    """Return a project's files."""
    ori = "120 50 600\n-0.05 0.2 0.01\n" + "0 " * 9 + "\n0.3 -0.2 60\n0 0 50\n"
    par = "1\nimg/cam1.1\ncal/cam1.tif\n1\n0\n1\n9\n7\n0.012\n0.0125\n0\n1\n1\n1\n6\n"
    return {
        "parameters/ptv.par": par.encode(),
        "cal/cam1.tif.ori": ori.encode(),
        "cal/cam1.tif.addpar": b"-4e-4 1e-7 0 2e-5 -3e-5 1.01 2e-3\n",
    }


def myptv() -> bytes:
    """Return a camera file of the newer kind, whose correction makes it a table of rays."""
    rows = "6e-3 -1e-2 -7e-6 9e-7 1.2e-5\n9e-3 -9e-3 -3e-6 9e-6 -8e-6\n0 0 0 0 0\n"
    return f"Tsai model camera\ncam1\n9 7\n1 2 500\n0.1 0.2 0.3\n900\n1 -1\n{rows}".encode()
