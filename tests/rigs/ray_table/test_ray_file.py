"""Tables of rays in files: what is read, and what is refused in one line."""

import re

import numpy as np
import pytest
import yaml

from rigs import Accuracy, load_rig, save_rig
from rigs.ray_table.ray_file import load_ray_table


def write(folder, entry, **arrays):
    np.savez(folder / "rays.npz", **arrays)
    data = {"format": "emission-rig", "version": 1, "cameras": [{"name": "a", **entry}]}
    path = folder / "rig.yaml"
    path.write_text(yaml.safe_dump(data))
    return path


GOOD = {"origins": np.zeros(3), "directions": np.ones((4, 5, 3))}


def test_origins_and_directions_are_enough(tmp_path):
    rig = load_rig(write(tmp_path, {"ray_table": "rays.npz"}, **GOOD))
    assert rig["a"].image_size == (5, 4)
    assert rig["a"].status == "nominal"
    assert rig["a"].accuracy is None


def test_accuracy_stands_beside_the_table(tmp_path):
    entry = {"ray_table": "rays.npz", "accuracy": {"shift": 0.3, "direction": 0.01}}
    rig = load_rig(write(tmp_path, entry, **GOOD))
    assert rig["a"].accuracy == Accuracy(shift=0.3, direction=0.01)
    save_rig(rig, tmp_path / "again.yaml")
    assert load_rig(tmp_path / "again.yaml") == rig


@pytest.mark.parametrize(
    ("entry", "arrays", "message"),
    [
        ({"ray_table": "../rays.npz"}, GOOD, "camera a: ray_table: found '../rays.npz', expected"),
        ({"ray_table": "/etc/passwd"}, GOOD, "camera a: ray_table: found '/etc/passwd', expected"),
        ({"ray_table": "rig.yaml"}, GOOD, "camera a: ray_table: rig.yaml: not a readable .npz"),
        (
            {"ray_table": "rays.npz", "R": np.eye(3).tolist()},
            GOOD,
            "camera a: R: found together with ray",
        ),
        ({"ray_table": "rays.npz", "image_size": [4, 5]}, GOOD, "camera a: image_size: found (4"),
        ({"ray_table": 3}, GOOD, "camera a: ray_table: found 3, expected text"),
        (
            {"ray_table": "rays.npz"},
            {"origins": np.zeros(3)},
            "camera a: ray_table: rays.npz: directions: missing",
        ),
        (
            {"ray_table": "rays.npz"},
            GOOD | {"origins": np.zeros((4, 4, 3))},
            "camera a: origins: found shape (4, 4, 3), expected (4, 5, 3) or (3,)",
        ),
        (
            {"ray_table": "rays.npz"},
            GOOD | {"directions": np.full((4, 5, 3), np.nan)},
            "camera a: directions: found no finite ray",
        ),
        (
            {"ray_table": "rays.npz"},
            GOOD | {"directions": np.array([["x"]])},
            "camera a: ray_table: rays.npz: directions: found <U1, expected real numbers",
        ),
        (
            {"ray_table": "rays.npz"},
            GOOD | {"colour": np.zeros(3)},
            "camera a: ray_table: rays.npz: colour: unknown array",
        ),
        ({"ray_table": "rays.npz"}, GOOD | {"scale": np.array(0.0)}, "camera a: scale: found 0.0"),
        ({}, GOOD, "camera a: image_size: missing"),
    ],
)
def test_bad_files_are_refused_in_one_line(tmp_path, entry, arrays, message):
    path = write(tmp_path, entry, **arrays)
    with pytest.raises(ValueError, match=re.escape(message)) as error:
        load_rig(path)
    assert str(error.value).startswith(f"{path}: {message}")
    assert "\n" not in str(error.value)


def test_a_single_array_under_the_name_of_several_is_refused(tmp_path):
    with (tmp_path / "rays.npz").open("wb") as file:
        np.save(file, np.ones((3, 4, 3)))
    with pytest.raises(ValueError, match=r"rays.npz: not a readable .npz"):
        load_ray_table("a", "rays.npz", tmp_path)


def test_pickles_are_not_opened(tmp_path):
    path = write(tmp_path, {"ray_table": "rays.npz"}, directions=np.array([{}], dtype=object))
    with pytest.raises(ValueError, match=r"rays.npz: not a readable .npz"):
        load_rig(path)
    (tmp_path / "rays.npz").unlink()
    with pytest.raises(FileNotFoundError, match=r"rays.npz: no such file, which camera a has"):
        load_rig(path)
