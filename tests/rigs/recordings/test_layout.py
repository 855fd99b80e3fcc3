"""Names of files and folders, by which images belong to cameras and moments."""

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from promptness import takes_less_than

from rigs.recordings import find_images
from rigs.recordings.layout import cameras_and_frames, how_to_name

CAMERAS = ("cam00", "cam01", "cam10")


def names(folder, *args):
    return {
        camera: {frame: path.relative_to(folder).as_posix() for frame, path in frames.items()}
        for camera, frames in find_images(folder, *args).items()
    }


@pytest.fixture
def make(tmp_path):
    """Return a function that makes empty files, and their folder."""

    def run(*paths):
        for path in paths:
            (tmp_path / path).parent.mkdir(parents=True, exist_ok=True)
            (tmp_path / path).touch()
        return tmp_path

    return run


LAYOUTS = [
    "{camera}/{frame}.tif",
    "{camera}/{camera}_{frame}.tif",
    "{camera}/{frame}-{camera}.png",
    "{camera}_{frame}.tif",
    "{camera}.{frame}.PNG",
]


@pytest.mark.parametrize("layout", LAYOUTS)
@pytest.mark.parametrize("cameras", [None, CAMERAS])
def test_usual_layouts_are_found(make, layout, cameras):
    frames = ("0001", "0002", "0010")
    paths = {c: {f: layout.format(camera=c, frame=f) for f in frames} for c in CAMERAS}
    folder = make(*(path for each in paths.values() for path in each.values()))
    make("notes.txt", ".cam00_0003.tif", "cam00.yaml")
    found = names(folder, cameras)
    assert found == paths
    assert [list(each) for each in found.values()] == [list(frames)] * 3


def test_a_camera_s_only_image_may_be_named_as_it(make):
    folder = make("cam00.tif", "cam01.png", "cam10/cam10.tif")
    expected = {"cam00": "cam00.tif", "cam01": "cam01.png", "cam10": "cam10/cam10.tif"}
    assert names(folder, CAMERAS) == {name: {"0": path} for name, path in expected.items()}


def test_known_names_may_stand_behind_the_moment_s_and_hold_each_other(make):
    folder = make("0001_cam1.tif", "0001_cam1_left.tif", "0002_cam1_left.tif")
    assert names(folder, ("cam1", "cam1_left")) == {
        "cam1": {"0001": "0001_cam1.tif"},
        "cam1_left": {"0001": "0001_cam1_left.tif", "0002": "0002_cam1_left.tif"},
    }


def test_words_after_every_camera_s_name_are_the_moment_s(make):
    folder = make(*(f"{name}_pose_{k:02d}.tif" for name in ("left", "right_up") for k in (1, 2)))
    found = {camera: list(frames) for camera, frames in find_images(folder).items()}
    assert found == {"left": ["pose_01", "pose_02"], "right_up": ["pose_01", "pose_02"]}
    assert found == {c: list(f) for c, f in find_images(folder, ("left", "right_up")).items()}
    make("right_up_other_03.tif")  # not all are alike: the names before the numbers
    assert set(find_images(folder)) == {"left_pose", "right_up_pose", "right_up_other"}


def test_folders_without_images_are_no_cameras(make):
    assert set(find_images(make("cam00_1.tif", "cam01_1.tif", "notes/a.txt"))) == {
        "cam00",
        "cam01",
    }


def test_a_name_that_only_begins_like_a_camera_s_is_not_its(make):
    folder = make("cam0_1.tif", "cam00_1.tif", "camera_1.tif")
    assert names(folder, ("cam0", "cam")) == {"cam0": {"1": "cam0_1.tif"}}


def test_frames_come_in_natural_order(make):
    folder = make("cam2/10.png", "cam2/9.png", "cam10/9.png", "cam10/10.png")
    assert {c: list(f) for c, f in find_images(folder).items()} == {
        "cam2": ["9", "10"],
        "cam10": ["9", "10"],
    }
    assert list(find_images(folder)) == ["cam2", "cam10"]


@pytest.mark.parametrize(
    ("pattern", "path"),
    [
        ("{camera}_{frame}.tif", "cam_00_0001.tif"),
        ("{frame}/{camera}.tif", "0001/cam_00.tif"),
        ("{camera}/raw/*_{frame}.tif", "cam_00/raw/shot_0001.tif"),
        ("run-{frame}_{camera}-x.tif", "run-0001_cam_00-x.tif"),
    ],
)
@pytest.mark.parametrize("cameras", [None, ("cam_00",)])
def test_a_pattern_says_where_the_names_stand(make, pattern, path, cameras):
    folder = make(path, "cam_00/raw/readme.md", "other.tif")
    assert names(folder, cameras, pattern) == {"cam_00": {"0001": path}}


def test_a_pattern_without_a_frame_is_one_moment(make):
    folder = make("shot-cam00.tif", "shot-cam01.tif")
    found = names(folder, None, "shot-{camera}.tif")
    assert found == {"cam00": {"0": "shot-cam00.tif"}, "cam01": {"0": "shot-cam01.tif"}}


@pytest.mark.parametrize(
    "pattern",
    ["", "{frame}.tif", "{camera}{camera}", "{camera}_{frame}_{frame}", "../{camera}", "/{camera}",
     "{camera}\\{frame}.tif"],
)  # fmt: skip
def test_a_pattern_that_says_nothing_is_refused(make, pattern):
    with pytest.raises(ValueError, match="pattern: found"):
        find_images(make("cam00.tif"), None, pattern)


@pytest.mark.parametrize("cameras", [None, ("left", "right")])
@pytest.mark.parametrize("pattern", ["{camera}{frame}.tif", "{frame}{camera}.tif"])
def test_a_frame_beside_the_camera_takes_all_digits(make, pattern, cameras):
    numbers = [str(number) for number in range(1, 13)]
    sides = ("left", "right")
    files = [pattern.format(camera=side, frame=number) for side in sides for number in numbers]
    found = find_images(make(*files), cameras, pattern)
    assert {camera: list(frames) for camera, frames in found.items()} == {
        side: numbers for side in sides
    }
    assert "left (12), right (12)" in cameras_and_frames(found)


def test_a_name_that_fits_two_cameras_is_refused(make):
    folder = make("cam101.tif", "cam11.tif")
    with pytest.raises(ValueError, match=r"cam101\.tif: pattern: .* cameras cam10 and cam1, exp"):
        find_images(folder, ("cam1", "cam10"), "{camera}{frame}.tif")


def test_two_images_of_one_moment_are_refused(make):
    folder = make("cam00/1.tif", "cam00/1.png")
    with pytest.raises(
        ValueError, match=r"1\.tif: camera cam00: found the frame '1' twice, 1\.png"
    ):
        find_images(folder)


def test_names_that_say_no_camera_are_left_to_a_pattern(make):
    assert find_images(make("left.tif", "right.tif")) == {}
    assert find_images(make("0001_0002.tif")) == {}


@settings(suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(
    st.text(min_size=1, max_size=30).filter(lambda name: name.isprintable()),
    st.lists(st.text("ab01_-. ", min_size=1, max_size=9), min_size=1, max_size=5),
)
def test_any_pattern_and_any_names_end_in_a_mapping_or_one_line(tmp_path, pattern, stems):
    for stem in stems:
        (tmp_path / f"{stem}.tif").touch()
    for arguments in ((None, pattern), (stems, None), (None, None), (stems, "{camera}" + pattern)):
        try:
            found = find_images(tmp_path, *arguments)
        except ValueError as error:
            assert "\n" not in str(error)  # noqa: PT017
        else:
            assert all(path.is_file() for each in found.values() for path in each.values())


def test_long_names_take_no_time(make):
    folder = make("_" * 200 + ".tif", "a_" * 100 + ".tif", "a1" * 100 + ".tif")
    with takes_less_than(2):
        assert find_images(folder) == {}
        assert find_images(folder, None, "*_*_*_{camera}_*_*_{frame}.tif") is not None


@pytest.mark.parametrize(
    ("paths", "cameras", "pattern"),
    [
        (["left.tif", "right.tif"], None, "{camera}.tif"),
        (["shot1_left-raw.tif", "shot1_right-raw.tif"], None, "shot1_{camera}-raw.tif"),
        (["0001_left.tif", "0002_right.tif"], None, "{camera}_{frame}.tif"),  # an example
        (["run3/0007left_x.tif"], ["left"], "run3/0007{camera}_x.tif"),
        (["a/xleft0007.tif"], ["lef", "left"], "a/x{camera}{frame}.tif"),
        ([], ["left"], "{camera}_{frame}.tif"),
    ],
)
def test_the_pattern_to_write_is_that_of_the_files(tmp_path, paths, cameras, pattern):
    words = how_to_name([tmp_path / path for path in paths], tmp_path, cameras)
    assert words.endswith(f"--pattern '{pattern}'")
