"""Films as input; the files are written by tifffile."""

import numpy as np
import pytest
import tifffile
import yaml

import rigs
from rigs.recordings.film_formats.tiff_stack import TiffStack
from tomo import load_scan, scan_of_images


@pytest.fixture
def films(tmp_path):
    """Return a folder of a rig and two films of seven frames, and the frames."""
    rig = rigs.ring(2, distance=50.0, image_size=(5, 4), footprint=1.0)
    rigs.save_rig(rig, tmp_path / "rig.yaml")
    rng = np.random.default_rng(0)
    frames = {}
    for name in rig.names:
        frames[name] = rng.integers(0, 60000, (7, 4, 5)).astype(np.uint16)
        tifffile.imwrite(tmp_path / f"{name}.tif", frames[name], photometric="minisblack")
    return tmp_path, frames


def write_scan(folder, **content):
    head = {"format": "emission-scan", "version": 1, "rig": "rig.yaml"}
    (folder / "scan.yaml").write_text(yaml.safe_dump(head | content))
    return folder


def test_pages_are_frames(films):
    folder, frames = films
    scan = scan_of_images(folder / "rig.yaml", folder)
    assert scan.frame_names == tuple("0123456")
    for number in (0, 6, 3):
        for name, image in zip(scan.rig.names, scan.images(str(number)), strict=True):
            np.testing.assert_array_equal(image, frames[name][number] / np.float32(65535))
    assert scan.holds_integers()


def test_scan_files_say_where_films_begin_and_which_camera_is_late(films):
    folder, frames = films
    write_scan(
        folder,
        films={"cam00": {"path": "cam00.tif", "first": 1, "step": 2},
               "cam01": {"path": "cam01.tif", "first": 1, "step": 2, "offset": 1}},
        frame_rate=500,
    )  # fmt: skip
    scan = load_scan(folder)
    assert scan.frame_rate == 500
    assert scan.frame_names == ("0", "1", "2", "3")
    first, second = scan.images("2")
    np.testing.assert_array_equal(first, frames["cam00"][5] / np.float32(65535))
    np.testing.assert_array_equal(second, frames["cam01"][4] / np.float32(65535))


def test_frames_that_a_late_camera_lacks_are_named_when_read(films):
    folder, _ = films
    write_scan(
        folder,
        films={"cam00": "cam00.tif", "cam01": {"path": "cam01.tif", "offset": 3}},
    )
    scan = load_scan(folder)
    assert len(scan.frames) == 10
    with pytest.raises(ValueError, match="frame '2': camera cam01: found no image"):
        scan.images("2")
    with pytest.raises(ValueError, match="frame '8': camera cam00: found no image"):
        scan.images("8")
    assert len(scan.images("4")) == 2


def test_one_page_at_a_time_is_read(films, monkeypatch):
    folder, _ = films
    read = []
    monkeypatch.setattr(
        TiffStack, "read", lambda self, place: read.append(place) or np.zeros((4, 5))
    )
    scan = scan_of_images(folder / "rig.yaml", folder)
    assert not read
    scan.images("5")
    assert read == [5, 5]


@pytest.mark.parametrize(
    ("films_field", "parts"),
    [
        ({"cam00": "cam00.tif", "cam09": "cam01.tif"}, ["films", "cam09"]),
        ({"cam00": "cam00.tif", "cam01": "none.tif"}, ["none.tif", "cam01", "no such film"]),
        ({"cam00": "../cam00.tif"}, ["films: camera cam00", "inside the scan folder"]),
        ({"cam00": {"path": "cam00.tif", "first": -1}}, ["films.cam00", "0 or more"]),
        ({"cam00": {"path": "cam00.tif", "step": 0}}, ["films.cam00", "1 or more"]),
        ({"cam00": {"path": "cam00.tif", "speed": 2}}, ["films.cam00", "unknown field"]),
        ({"cam00": {"first": 2}}, ["films.cam00", "missing"]),
        ({"cam00": "cam00.tif", "cam01": {"path": "cam01.tif", "offset": 9}}, ["in all films"]),
        ({}, ["frames: missing"]),
    ],
)
def test_bad_films_are_refused_in_one_line(films, films_field, parts):
    folder, _ = films
    write_scan(folder, films=films_field)
    with pytest.raises((ValueError, FileNotFoundError)) as caught:
        load_scan(folder)
    for part in parts:
        assert part in str(caught.value)
    assert "\n" not in str(caught.value)


def test_films_and_frames_exclude_each_other(films):
    folder, _ = films
    frames = [{"name": "a", "images": {"cam00": "cam00.tif"}}]
    write_scan(folder, films={"cam00": "cam00.tif"}, frames=frames)
    with pytest.raises(ValueError, match="films: found frames too"):
        load_scan(folder)


def test_a_damaged_page_is_named(films):
    folder, frames = films
    path = folder / "cam01.tif"
    tifffile.imwrite(path, frames["cam01"], compression="zlib", photometric="minisblack")
    with tifffile.TiffFile(path) as file:
        place = file.pages.get(6).dataoffsets[0]
    content = path.read_bytes()
    path.write_bytes(content[:place] + bytes(20) + content[place + 20 :])
    scan = scan_of_images(folder / "rig.yaml", folder)
    assert len(scan.images("5")) == 2
    with pytest.raises(ValueError, match=r"cam01\.tif: frame 6") as caught:
        scan.images("6")
    assert "\n" not in str(caught.value)


def test_films_of_another_size_are_refused_by_name(films):
    folder, _ = films
    tifffile.imwrite(
        folder / "cam01.tif", np.zeros((7, 3, 3), np.uint16), photometric="minisblack"
    )
    scan = scan_of_images(folder / "rig.yaml", folder)
    with pytest.raises(ValueError, match=r"cam01\.tif: frame 0: camera cam01: .* 3 x 3 pixels"):
        scan.images("0")
