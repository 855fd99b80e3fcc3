"""Patterns found from names: they find the files that they were found from."""

from pathlib import PurePosixPath

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from rigs.recordings import find_images
from rigs.recordings.naming import patterns_of

CAMERAS = ("cam0", "cam1", "cam10", "left")
FRAMES = ("0001", "0002", "0010")
LAYOUTS = {
    "images/{c}/{f}.tif": "images/{camera}/{frame}.tif",
    "{c}/raw/img_{f}.tif": "{camera}/raw/{frame}.tif",
    "{c}_{f}.tif": "{camera}_{frame}.tif",
    "run3-{c}-exp5_{f}.png": "run3-{camera}-exp5_{frame}.png",
    "{f}_{c}.tif": "{frame}_{camera}.tif",
    "a/{f}/{c}.tif": "a/{frame}/{camera}.tif",
    "{f}/x_{c}.tif": "{frame}/x_{camera}.tif",
    "{c}/{c}-{f}.tif": "{camera}/*-{frame}.tif",
}


def paths(layout, frames=FRAMES, cameras=CAMERAS):
    return [PurePosixPath(layout.format(c=c, f=f)) for c in cameras for f in frames]


@pytest.mark.parametrize("layout", LAYOUTS)
def test_a_layout_is_found_and_finds_its_files_again(tmp_path, layout):
    (pattern,) = found = patterns_of(paths(layout), CAMERAS)
    assert pattern == LAYOUTS[layout]
    assert list(found[pattern]) == list(CAMERAS)
    for path in paths(layout):
        (tmp_path / path).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / path).touch()
    again = find_images(tmp_path, CAMERAS, pattern)
    assert again == {
        camera: {frame: tmp_path / path for frame, path in own.items()}
        for camera, own in found[pattern].items()
    }


def test_an_image_a_camera_needs_no_frame():
    files = [PurePosixPath(f"flame_{camera}.tif") for camera in CAMERAS]
    (pattern,) = found = patterns_of(files, CAMERAS)
    assert pattern == "flame_{camera}.tif"
    assert {camera: list(own) for camera, own in found[pattern].items()} == {
        camera: ["0"] for camera in CAMERAS
    }


def test_numbers_beside_the_frame_are_kept_only_where_all_share_them():
    clock = iter(range(101, 999))
    files = [
        PurePosixPath(f"{camera}_20240101_{next(clock)}_{frame}.tif")
        for camera in CAMERAS
        for frame in FRAMES
    ]
    assert list(patterns_of(files, CAMERAS)) == ["{camera}_20240101_*_{frame}.tif"]


def test_images_of_several_kinds_are_several_patterns():
    kinds = [*paths("images/{c}/{f}.tif"), *paths("target/{c}/{f}.tif"), *paths("{c}_{f}.png")]
    assert set(patterns_of(kinds, CAMERAS)) == {
        "images/{camera}/{frame}.tif", "target/{camera}/{frame}.tif", "{camera}_{frame}.png"
    }  # fmt: skip
    words = paths("{c}_{f}.tif", ("raw", "filtered"))
    assert set(patterns_of(words, CAMERAS)) == {"{camera}_raw.tif", "{camera}_filtered.tif"}
    folders = paths("{f}/{c}.tif", ("raw", "filtered"))
    assert set(patterns_of(folders, CAMERAS)) == {"raw/{camera}.tif", "filtered/{camera}.tif"}


def test_names_that_could_be_either_give_both_readings():
    files = paths("{c}/{f}.tif", ("1", "2"), ("1", "2"))
    found = patterns_of(files, ("1", "2"))
    assert found["{camera}/{frame}.tif"]["1"].keys() == {"1", "2"}
    assert len(found) == 2


def test_what_names_no_camera_has_no_pattern():
    assert patterns_of(paths("{c}1/{f}.tif"), ("cam0", "left")) == {}
    assert patterns_of(paths("{c}/{f}.tif"), ()) == {}


NAME = st.text("abcXYZ019_-. (é", min_size=1, max_size=6).filter(
    lambda text: text.strip(". ") == text and any(map(str.isalpha, text))
)


@given(
    cameras=st.lists(NAME, min_size=2, max_size=4, unique_by=str.casefold),
    layout=st.sampled_from(["{c}/{f}.tif", "x/{c}/a{f}.tif", "{f}/{c}.tif"]),
)
@settings(suppress_health_check=list(HealthCheck))
def test_cameras_of_any_name_are_found_in_folders_and_files(cameras, layout):
    found = patterns_of(paths(layout, FRAMES, cameras), cameras)
    whole = [own for own in found.values() if set(own) == set(cameras)]
    assert any({len(frames) for frames in own.values()} == {3} for own in whole)
