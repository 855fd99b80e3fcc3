"""Rig files written and read again: nothing is lost, and others can read them."""

import dataclasses
import os

import cv2
import numpy as np
import pytest
from hypothesis import HealthCheck, example, given, settings
from hypothesis import strategies as st

from rigs import (
    Accuracy,
    Camera,
    Distortion,
    Optics,
    RayTable,
    Rig,
    Volume,
    load_rig,
    look_at,
    ring,
    save_rig,
)
from rigs.files import write_rig

COUNTS = {"none": 0, "brown": 5, "rational": 8, "thin_prism": 12, "tilted": 14, "fisheye": 4}
EVERYWHERE = settings(suppress_health_check=[HealthCheck.function_scoped_fixture])


def random_rig(seed):
    rng = np.random.default_rng(seed)
    cameras = []
    for index, (model, count) in enumerate(COUNTS.items()):
        R, t = look_at(rng.normal(size=3) * 1e3, rng.normal(size=3))
        fx, ratio = rng.uniform(1, 1e5), rng.uniform(0.2, 5)
        K = [[fx, 0, rng.normal()], [0, fx * ratio, 1e-7], [0, 0, 1]]
        lens = Distortion(model, tuple(rng.normal(size=count) * 10.0 ** rng.integers(-9, 0)))
        optics = Optics(f_number=2.8, focal_length=rng.uniform(1, 99)) if index % 2 else None
        status = ("calibrated", "nominal", "virtual")[index % 3]
        accuracy = Accuracy(shift=rng.uniform(), direction=1e-7) if index % 4 > 1 else None
        cameras.append(Camera(f"cam{index}", (640, 480), K, lens, R, t, optics, status, accuracy))
    calibration = {"date": "2024-05-01", "ray_miss": {"rms": 0.1 + 0.2}, "list": [1, [2.5], "no"]}
    volume = Volume((3, 4, 5), rng.uniform(0.1, 1, 3), rng.normal(size=3))
    return Rig(tuple(cameras), "mm", "y up: 'x' µm # no comment", volume, calibration)


@given(seed=st.integers(0, 2**32 - 1))
@settings(EVERYWHERE)
def test_a_rig_comes_back_bit_by_bit(seed, tmp_path):
    rig = random_rig(seed)
    save_rig(rig, tmp_path / "rig.yaml")
    assert load_rig(tmp_path / "rig.yaml") == rig
    assert os.listdir(tmp_path) == ["rig.yaml"]  # no temporary file is left


@given(texts=st.lists(st.text(max_size=30), min_size=1, max_size=8))
@settings(EVERYWHERE, max_examples=10)
@example(texts=["line\nbreak: \t{", "null", "é\x85\u2028"])
def test_any_text_comes_back(texts, tmp_path):
    notes = {"note": texts}
    rig = dataclasses.replace(random_rig(0)[:1], world_frame=texts[0], calibration=notes)
    try:
        save_rig(rig, tmp_path / "rig.yaml")
    except UnicodeEncodeError:
        pytest.fail("text that cannot be written")
    assert load_rig(tmp_path / "rig.yaml") == rig


def test_opencv_reads_what_is_written(tmp_path):
    rig = random_rig(1)
    save_rig(rig, tmp_path / "rig.yaml")
    storage = cv2.FileStorage(str(tmp_path / "rig.yaml"), cv2.FILE_STORAGE_READ)
    assert storage.getNode("format").string() == "emission-rig"
    assert storage.getNode("world_frame").string() == rig.world_frame
    cameras = storage.getNode("cameras")
    assert cameras.size() == len(rig)

    def numbers(node):
        if node.isSeq():
            return [numbers(node.at(i)) for i in range(node.size())]
        return node.real()

    for index, camera in enumerate(rig):
        node = cameras.at(index)
        assert node.getNode("name").string() == camera.name
        assert numbers(node.getNode("image_size")) == list(camera.image_size)
        lens = node.getNode("distortion")
        assert lens.getNode("model").string() == camera.distortion.model
        for name, expected in (
            ("camera_matrix", camera.camera_matrix),
            ("R", camera.R),
            ("t", camera.t),
        ):
            np.testing.assert_allclose(numbers(node.getNode(name)), expected, rtol=1e-14)
        np.testing.assert_allclose(
            numbers(lens.getNode("coefficients")), camera.distortion.coefficients, rtol=1e-14
        )
    assert numbers(storage.getNode("volume").getNode("shape")) == [3, 4, 5]


def test_a_failed_save_leaves_the_old_file(tmp_path):
    path = tmp_path / "rig.yaml"
    rig = ring(2, distance=5, image_size=(4, 4), footprint=1)
    save_rig(rig, path)
    before = path.read_text()
    with pytest.raises(ValueError, match=r"calibration\.when: found ndarray, expected plain"):
        save_rig(dataclasses.replace(rig, calibration={"when": np.zeros(2)}), path)
    assert path.read_text() == before
    assert os.listdir(tmp_path) == ["rig.yaml"]


def test_a_rig_with_files_beside_it_is_replaced_as_a_whole(tmp_path, monkeypatch):
    rig = ring(2, distance=500.0, image_size=(12, 10), footprint=1.0)
    tables = dataclasses.replace(rig, cameras=tuple(map(RayTable.of, rig)))
    moved = dataclasses.replace(
        tables, cameras=tuple(one.with_lengths_scaled(2.0) for one in tables)
    )
    save_rig(tables, tmp_path / "rig.yaml")

    def full_disk(path, text):
        raise OSError("no room")

    monkeypatch.setattr(write_rig, "write_text", full_disk)
    with pytest.raises(OSError, match="no room"):
        save_rig(moved, tmp_path / "rig.yaml")
    assert load_rig(tmp_path / "rig.yaml") == tables
    monkeypatch.undo()
    save_rig(moved, tmp_path / "rig.yaml")
    assert load_rig(tmp_path / "rig.yaml") == moved
