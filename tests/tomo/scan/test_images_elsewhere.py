"""A transforms.json whose images lie elsewhere: a rig, but no scan without ``images``."""

import json

import numpy as np
import pytest

from rigs import formats
from rigs.formats.transforms import save_transforms
from rigs.recordings import write_image
from tomo import load_scan

from .conftest import SIZES, random_images

ELSEWHERE = [
    "../shots/images/{name}/0001.tif",
    "/data/shots/images/{name}/0001.tif",
    r"D:\shots\images\{name}\0001.tif",
    r"\\nas\shots\images\{name}\0001.tif",
    r"..\shots\images\{name}\0001.tif",
]


@pytest.fixture
def shots(tmp_path):
    """A folder of images ``images/<camera>/0001.tif``, beside the one of the file."""
    for name, image in random_images(0).items():
        write_image(tmp_path / f"shots/images/{name}/0001.tif", image)
    return tmp_path / "shots"


def write(tmp_path, rig, pattern):
    """Write a transforms.json with images as ``pattern`` says, into a folder of its own."""
    path = tmp_path / "scan" / "transforms.json"
    save_transforms(rig, path)
    data = json.loads(path.read_text())
    for entry in data["frames"]:
        entry["file_path"] = pattern.format(name=entry.pop("camera"))
    path.write_text(json.dumps(data))
    return path


@pytest.mark.parametrize("pattern", ELSEWHERE)
def test_the_rig_is_read_and_images_are_asked_for(tmp_path, rig, shots, assert_refused, pattern):
    path = write(tmp_path, rig, pattern)
    assert formats.load(path).names == rig.names
    words = (
        "frame '0001'",
        "camera left",
        "file_path",
        "inside the scan folder",
        "images='FOLDER'",
    )
    assert_refused(lambda: load_scan(path), *words)


@pytest.mark.parametrize("pattern", [*ELSEWHERE, "images/{name}/0001.tif"])
@pytest.mark.parametrize("folder", ["shots", "shots/images"])
def test_a_folder_of_images_answers(tmp_path, rig, shots, pattern, folder):
    scan = load_scan(write(tmp_path, rig, pattern), tmp_path / folder)
    for image, expected in zip(scan.images(), random_images(0).values(), strict=True):
        np.testing.assert_array_equal(image, expected)


def test_flat_names_are_found_in_one_folder(tmp_path, rig, shots):
    for name in SIZES:
        (shots / f"images/{name}/0001.tif").rename(shots / f"{name}.tif")
    scan = load_scan(write(tmp_path, rig, "/data/{name}.tif"), shots)
    assert [image.shape for image in scan.images()] == [(5, 7), (8, 9)]


def test_moments_of_fixed_cameras_in_one_folder(tmp_path, rig):
    """Four images of two cameras at two moments are two frames, not four cameras."""
    path = write(tmp_path, rig, "images/{name}_0001.tif")
    data = json.loads(path.read_text())
    later = [
        {**entry, "file_path": entry["file_path"].replace("0001", "0002")}
        for entry in data["frames"]
    ]
    path.write_text(json.dumps({**data, "frames": data["frames"] + later}))
    for moment in (1, 2):
        for name, image in random_images(moment).items():
            write_image(path.parent / f"images/{name}_{moment:04d}.tif", image)
    scan = load_scan(path)
    assert scan.rig.names == rig.names
    for moment in (1, 2):
        expected = random_images(moment).values()
        for image, values in zip(scan.images(f"{moment:04d}"), expected, strict=True):
            np.testing.assert_array_equal(image, values)


def test_what_is_not_in_the_folder_is_named(tmp_path, rig, shots):
    path = write(tmp_path, rig, "/data/{name}/0002.tif")
    with pytest.raises(
        FileNotFoundError, match=r"frame '0002': camera left: .*found no file 0002"
    ):
        load_scan(path, shots)
    with pytest.raises(FileNotFoundError, match="no such folder of images"):
        load_scan(path, tmp_path / "nothing")


def test_one_file_is_no_image_of_two_cameras(tmp_path, rig, shots):
    (shots / "images/left/0001.tif").rename(shots / "0001.tif")
    (shots / "images/right/0001.tif").unlink()
    path = write(tmp_path, rig, "/data/{name}/0001.tif")
    with pytest.raises(ValueError, match=r"found .*0001.tif for camera left of frame '0001' too"):
        load_scan(path, shots)


def test_links_do_not_lead_out_of_the_folder_of_images(tmp_path, rig, shots):
    (tmp_path / "linked").mkdir()
    (tmp_path / "linked/left").symlink_to(shots / "images/left")
    (tmp_path / "linked/right").symlink_to(shots / "images/right")
    with pytest.raises(FileNotFoundError, match="camera left"):
        load_scan(write(tmp_path, rig, "{name}/0001.tif"), tmp_path / "linked")


def test_a_scan_file_names_its_images_itself(folder, shots):
    with pytest.raises(ValueError, match=r"scan.yaml: images: found .*shots, expected none"):
        load_scan(folder, shots)
