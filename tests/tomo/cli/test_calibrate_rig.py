"""Calibration through its command: small rendered rigs, and everything that can be wrong."""

import json
import shutil
from dataclasses import replace

import cv2
import numpy as np
import pytest
import yaml

from rigs import Rig, load_rig, save_rig
from rigs.calibrate.targets import parse_target
from rigs.files import atomic_path

TARGET = "charuco:7x5:24:18:DICT_4X4_50"
CAMERAS = ("cam00", "cam01", "cam02")
FRAMES = 8


@pytest.fixture(scope="module")
def taken(run_tool, tmp_path_factory):
    """Return the true rig, small images of a board that all its cameras took, and their folder."""
    from studies.calibration.rendering import Board
    from studies.calibration.scenes import Poses, arc_rig, held, photograph

    rig = arc_rig(1, 3, 60.0)
    rig = replace(rig, cameras=tuple(camera.scaled(0.4) for camera in rig))
    target = parse_target(TARGET)
    poses = held(Poses(FRAMES, shift=25.0), target.points.mean(axis=0), np.random.default_rng(2))
    folder = tmp_path_factory.mktemp("taken") / "images"
    photograph(folder, rig, Board.of(target, 3.0), poses, seed=1)
    return rig, folder


@pytest.fixture(scope="module")
def calibrated(run_tool, taken, tmp_path_factory):
    """Return what the command says and where its files are."""
    folder = tmp_path_factory.mktemp("calibrated")
    done = run_tool(
        "calibrate_rig", taken[1], "--target", TARGET, "-o", folder / "rig.yaml",
        "--cache", folder / "cache", "--json",
    )  # fmt: skip
    assert done.exit_code == 0, (done.stderr, done.exception)
    return json.loads(done.stdout), folder, done.stderr


@pytest.fixture(autouse=True)
def _no_pictures(monkeypatch):
    """No page is drawn, but for that of `calibrated`: pages take two thirds of a run's time."""

    def blank(path, *_, **__):
        with atomic_path(path) as temporary:
            temporary.touch()

    monkeypatch.setattr("tomo.draw.calibration.write_calibration_page", blank)


@pytest.fixture
def images(taken, tmp_path):
    shutil.copytree(taken[1], tmp_path / "images")
    return tmp_path / "images"


@pytest.fixture
def few(images):
    """Return a folder with three images a camera, which is soon searched."""
    for camera in CAMERAS:
        for path in sorted((images / camera).iterdir())[3:]:
            path.unlink()
    return images


@pytest.fixture
def refused(run_tool, tmp_path):
    """Return a function that runs the command on bad input and returns the line it says."""

    def run(images, *options, target=TARGET):
        out = tmp_path / "out" / "rig.yaml"
        done = run_tool("calibrate_rig", images, "--target", target, "-o", out, *options)
        assert done.exit_code == 2, (done.stderr, done.exception)
        lines = [line for line in done.stderr.splitlines() if line.startswith("error: ")]
        assert len(lines) == 1, done.stderr
        assert "Traceback" not in done.stderr
        assert done.stderr.rstrip().endswith(lines[0])
        assert not out.parent.exists() or not list(out.parent.iterdir())
        return lines[0]

    return run


def test_the_rig_s_rays_meet_where_the_true_ones_do(taken, calibrated):
    from studies.calibration.study import true_ray_miss

    report, folder, _ = calibrated
    rig = load_rig(folder / "rig.yaml")
    assert rig.names == CAMERAS
    assert all(camera.status == "calibrated" for camera in rig)
    miss = true_ray_miss(taken[0], rig, taken[0].volume)
    assert miss < 0.03  # mm, at pixels of 0.8 mm
    assert report["ray_miss_predicted"] < 0.03
    assert report["rms_px"] < 0.15
    assert rig.calibration["assessment"] == report["assessment"]


def test_the_files_are_next_to_the_rig_and_agree_with_what_is_printed(calibrated):
    report, folder, stderr = calibrated
    assert sorted(path.name for path in folder.iterdir() if path.suffix) == [
        "rig.yaml", "rig_calibration.html", "rig_calibration.json",
    ]  # fmt: skip
    written = json.loads((folder / "rig_calibration.json").read_text("utf-8"))
    assert written == {k: v for k, v in report.items() if k not in ("rig", "page")}
    assert len(written["frames_rms_px"]) == FRAMES
    assert set(written["images_rms_px"]) == set(CAMERAS)
    assert len(written["left_out"]) == written["points_left_out"]
    page = (folder / "rig_calibration.html").read_text("utf-8")
    assert "Images that fit worst" in page
    assert report["assessment"].split("\n")[0] in stderr


def test_the_cache_saves_the_search_and_changes_nothing(run_tool, taken, calibrated, tmp_path):
    _, folder, _ = calibrated
    done = run_tool(
        "calibrate_rig", taken[1], "--target", TARGET, "-o", tmp_path / "rig.yaml",
        "--cache", folder / "cache", "--report", tmp_path / "report", "--json",
    )  # fmt: skip
    assert done.exit_code == 0, (done.stderr, done.exception)
    assert load_rig(tmp_path / "rig.yaml") == load_rig(folder / "rig.yaml")
    assert sorted(p.name for p in (tmp_path / "report").iterdir()) == [
        "rig_calibration.html", "rig_calibration.json",
    ]  # fmt: skip


PANE = {"name": "pane", "type": "window", "point": [0, 0, 200], "normal": [0.4, 0, -0.9],
        "thickness": 10, "index": "quartz", "size": 160}  # fmt: skip


def test_a_scene_becomes_part_of_the_rig_and_its_windows_are_reported(
    run_tool, taken, calibrated, tmp_path, monkeypatch
):
    """No pane was there: what is adjusted of it contradicts what was given."""
    monkeypatch.undo()  # its page is looked at
    (tmp_path / "scene.yaml").write_text(yaml.safe_dump({"scene": {"solids": [PANE]}}), "utf-8")
    done = run_tool(
        "calibrate_rig", taken[1], "--target", TARGET, "-o", tmp_path / "rig.yaml", "--json",
        "--cache", calibrated[1] / "cache", "--scene", tmp_path / "scene.yaml",
        "--refine-window", "pane:thickness=0.2",
    )  # fmt: skip
    assert done.exit_code == 0, (done.stderr, done.exception)
    report, rig = json.loads(done.stdout), load_rig(tmp_path / "rig.yaml")
    assert report["cameras"]["cam00"]["looked_through"] == ["pane"]
    assert report["cameras"]["cam02"]["looked_through"] == []
    found = report["windows"]["pane"]
    assert rig.scene.solids[0].thickness == pytest.approx(found["thickness"], rel=1e-5)
    assert found["thickness_change"] < 0
    assert "window pane: thickness changed by" in done.stderr
    assert "window pane" in (tmp_path / "rig_calibration.html").read_text("utf-8")


@pytest.mark.parametrize(
    ("data", "options", "message"),
    [
        ({"solids": []}, (), "scene: found no solids"),
        ({"solids": [PANE | {"index": 0.5}]}, (), "solid pane: index: found 0.5"),
        ({"solids": [PANE | {"depth": 1}]}, (), "depth"),
        ({"solids": [PANE]}, ("--refine-window", "rim:normal=1"), "window rim: found no such"),
        ({"solids": [PANE]}, ("--refine-window", "pane:1"), "expected NAME:normal=DEGREES"),
        ({"solids": [PANE]}, ("--world", "world.yaml", "--rescale"), "rescale: found True with"),
        (None, ("--refine-window", "pane:normal=1"), "expected --scene FILE"),
    ],
)
def test_scenes_that_cannot_be_are_refused(images, refused, tmp_path, data, options, message):
    file = tmp_path / "scene.yaml"
    file.write_text(yaml.safe_dump(data), "utf-8")
    world = {name: [k, k * k, 0] for k, name in enumerate(CAMERAS)}
    (tmp_path / "world.yaml").write_text(yaml.safe_dump(world), "utf-8")
    options = [tmp_path / o if o == "world.yaml" else o for o in options]
    given = () if data is None else ("--scene", file)
    assert message in refused(images, *given, *options)


def test_lenses_that_are_given_stay_and_the_world_is_where_it_was_asked_for(
    run_tool, taken, tmp_path
):
    true, folder = taken
    save_rig(true, tmp_path / "true.yaml")
    positions = {camera.name: np.add(camera.position, [5.0, 0, 0]).tolist() for camera in true}
    (tmp_path / "world.yaml").write_text(yaml.safe_dump(positions), "utf-8")
    done = run_tool(
        "calibrate_rig", folder, "--target", TARGET, "-o", tmp_path / "rig.yaml",
        "--intrinsics", tmp_path / "true.yaml", "--world", tmp_path / "world.yaml",
        "--grid", "10x20x10", "--spacing", "4", "--center", "5,0,0",
    )  # fmt: skip
    assert done.exit_code == 0, (done.stderr, done.exception)
    rig = load_rig(tmp_path / "rig.yaml")
    assert (rig.volume.shape, rig.volume.center) == ((10, 20, 10), (5.0, 0.0, 0.0))
    for camera, known in zip(rig, true, strict=True):
        np.testing.assert_array_equal(camera.camera_matrix, known.camera_matrix)
        assert camera.distortion == known.distortion
        np.testing.assert_allclose(camera.position, positions[camera.name], atol=0.3)


def test_names_of_numbers_are_taken_as_they_are_written(run_tool, tmp_path, images):
    """YAML has 010 for eight."""
    for number, camera in enumerate(CAMERAS):
        (images / camera).rename(images / f"0{number + 9}")
    (tmp_path / "world.yaml").write_text(
        "09: [0, 0, 0]\n010: [0, 1, 0]\n011: [1, 0, 0]\n", "utf-8"
    )
    done = run_tool(
        "calibrate_rig", images, "--target", TARGET, "-o", tmp_path / "rig.yaml",
        "--world", tmp_path / "world.yaml", "--rescale",
    )  # fmt: skip
    assert done.exit_code == 0, (done.stderr, done.exception)
    assert "given positions of 09, 010, 011" in load_rig(tmp_path / "rig.yaml").world_frame


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("- 1", "world.yaml: found a list, expected a YAML mapping"),
        ("cam00: [1, 2]", "world.yaml: cam00: found shape (2,), expected 3 numbers"),
        ("cam00: here", "world.yaml: cam00: found 'here', expected 3 numbers"),
        ("cam00: [1, 2, .nan]", "world.yaml: cam00: found NaN or infinity"),
        ("cam00: [1, 2, 3", "world.yaml: broken YAML"),
        ("a: [1, 2, 3]\na: [1, 2, 3]", "world.yaml: a: found twice"),
    ],
)
def test_a_world_file_that_will_not_do(refused, tmp_path, text, words):
    (tmp_path / "world.yaml").write_text(text, "utf-8")
    assert words in refused(tmp_path, "--world", tmp_path / "world.yaml")


def turned_into(image, change):
    """Rewrite an image file."""
    assert cv2.imwrite(str(image), change(cv2.imread(str(image), cv2.IMREAD_GRAYSCALE)))


def test_images_of_different_sizes(refused, few):
    turned_into(few / "cam01" / "pose_002.png", lambda image: image[:-2])
    line = refused(few)
    assert "camera cam01" in line
    assert "pose_002.png" in line
    assert "320x254" in line


def test_a_camera_that_never_shows_the_target(refused, few):
    for path in (few / "cam02").iterdir():
        turned_into(path, lambda image: image // 8 * 0 + 90)
    line = refused(few)
    assert "camera cam02" in line
    assert str(few / "cam02") in line or "pose_00" in line


@pytest.mark.parametrize("kept", [1, 2])
def test_too_few_views(refused, few, kept):
    for camera in CAMERAS:
        for path in sorted((few / camera).iterdir())[kept:]:
            path.unlink()
    line = refused(few)
    assert "camera cam00" in line
    assert f"found {kept} " in line


def test_a_camera_without_shared_views(refused, few):
    for number, camera in enumerate(CAMERAS):
        for path in (few / camera).iterdir():
            path.rename(path.with_stem(f"{path.stem}_{number if number == 2 else 0}"))
    line = refused(few)
    assert "cam02" in line
    assert "share" in line or "shared" in line


def test_a_target_that_is_mirrored(refused, few):
    for path in few.glob("*/*.png"):
        turned_into(path, lambda image: image[:, ::-1])
    line = refused(few)
    assert "mirror" in line
    assert "camera cam0" in line
    assert ".png" in line


def test_a_wrong_count_of_squares(refused, few):
    line = refused(few, target="charuco:6x5:24:18:DICT_4X4_50")
    assert "camera cam00" in line
    assert "found markers of a board of 7x5 squares, not 6x5 (say charuco:7x5:24.0:18.0:" in line
    assert "pose_000.png" in line


def test_a_video_that_cannot_be_decoded(refused, tmp_path):
    (tmp_path / "videos").mkdir()
    (tmp_path / "videos" / "cam03.mp4").write_bytes(b"no video")
    assert "cam03.mp4" in refused(tmp_path / "videos")


def test_an_image_that_cannot_be_read(refused, few):
    (few / "cam01" / "pose_002.png").write_bytes(b"\x89PNG, cut off")
    line = refused(few)
    assert "camera cam01" in line
    assert "pose_002.png" in line


def test_a_target_that_looks_the_same_from_two_sides(refused, few):
    assert "turned by 180 degrees" in refused(few, target="circles:7x5:24")


def test_a_frame_that_stands_twice_counts_once(run_tool, images, tmp_path, calibrated):
    for camera in CAMERAS:
        shutil.copy(images / camera / "pose_004.png", images / camera / "pose_099.png")
    done = run_tool(
        "calibrate_rig", images, "--target", TARGET, "-o", tmp_path / "rig.yaml", "--json"
    )
    assert done.exit_code == 0, (done.stderr, done.exception)
    report, _, _ = calibrated
    again = json.loads(done.stdout)
    assert again["points_used"] == report["points_used"]
    assert "pose_099" in again["assessment"]


def test_images_that_do_not_belong_are_named_and_left_out(run_tool, images, tmp_path, taken):
    """One is blurred along its columns; one was taken at another moment than its name says."""
    from studies.calibration.study import true_ray_miss

    turned_into(images / "cam01" / "pose_004.png", lambda grey: cv2.blur(grey, (1, 13)))
    shutil.copy(images / "cam02" / "pose_002.png", images / "cam02" / "pose_006.png")
    out = tmp_path / "rig.yaml"
    done = run_tool("calibrate_rig", images, "--target", TARGET, "-o", out)
    assert done.exit_code == 0, (done.stderr, done.exception)
    for camera, frame in (("cam01", "pose_004"), ("cam02", "pose_006")):
        assert any(camera in line and frame in line for line in done.stderr.splitlines())
    assert true_ray_miss(taken[0], load_rig(out), taken[0].volume) < 0.03


OPTIONS = {
    "target": ((), "cuboid:3", "target: found 'cuboid:3', expected one of"),
    "suffix": (("-o", "rig.txt"), TARGET, "rig.txt: suffix: found '.txt', expected .yaml"),
    "world file": (("--world", "none.yaml"), TARGET, "none.yaml: no such file"),
    "intrinsics": (("--intrinsics", "none.yaml"), TARGET, "none.yaml"),
    "grid": (("--grid", "3x4"), TARGET, "--grid"),
}


@pytest.mark.parametrize("fault", OPTIONS)
def test_a_wrong_option(refused, taken, fault, calibrated):
    options, target, words = OPTIONS[fault]
    cache = ("--cache", calibrated[1] / "cache")
    assert words in refused(taken[1], *options, *cache, target=target)


def test_intrinsics_of_other_cameras(refused, taken, tmp_path, calibrated):
    save_rig(Rig(taken[0].cameras[:2]), tmp_path / "two.yaml")
    line = refused(
        taken[1], "--intrinsics", tmp_path / "two.yaml", "--cache", calibrated[1] / "cache"
    )
    assert "camera cam02" in line


def test_no_such_folder(refused, tmp_path):
    assert "nowhere" in refused(tmp_path / "nowhere")


def test_swapped_counts_of_a_charuco_board_are_named(refused, few):
    line = refused(few, target="charuco:5x7:24:18:DICT_4X4_50")
    assert "found markers of a board of 7x5 squares, not 5x7" in line
    assert "(say charuco:7x5:24.0:18.0:DICT_4X4_50), expected charuco:5x7:24.0:18.0" in line


def test_a_folder_of_texts_among_the_cameras_is_no_camera(run_tool, images, tmp_path, calibrated):
    (images / "notes").mkdir()
    (images / "notes" / "read me.txt").write_text("exposure 4 ms", "utf-8")
    done = run_tool(
        "calibrate_rig", images, "--target", TARGET, "-o", tmp_path / "rig.yaml", "--json"
    )
    assert done.exit_code == 0, (done.stderr, done.exception)
    report = json.loads(done.stdout)
    assert list(report["cameras"]) == list(CAMERAS)
    assert any("notes: holds no image" in note for note in report["notes"])
    assert report["rms_px"] == calibrated[0]["rms_px"]


@pytest.mark.parametrize(("name", "words"), [("empty", "it is empty"), ("raw", ".cine")])
def test_a_folder_without_images_says_what_it_holds(refused, few, name, words):
    (few / name).mkdir()
    if name == "raw":
        (few / name / "shot.cine").write_bytes(b"\0")
    line = refused(few)
    assert f"camera {name}: found no images ({words})" in line


def test_lens_images_are_kept_apart_from_pose_images(run_tool, taken, few, tmp_path):
    """Three images of all cameras at once say little of their lenses; others need not be."""
    from studies.calibration.study import true_ray_miss

    lenses = tmp_path / "lenses"
    for number, camera in enumerate(CAMERAS):
        (lenses / camera).mkdir(parents=True)
        for k, path in enumerate(sorted((taken[1] / camera).iterdir())[3:]):
            shutil.copy(path, lenses / camera / f"{k + number}.png")  # other moments by name
    miss = {}
    for name, options in (("without", ()), ("with", ("--intrinsics-images", lenses))):
        out = tmp_path / name / "rig.yaml"
        done = run_tool("calibrate_rig", few, "--target", TARGET, "-o", out, *options)
        assert done.exit_code == 0, (done.stderr, done.exception)
        miss[name] = true_ray_miss(taken[0], load_rig(out), taken[0].volume)
    assert miss["with"] < 0.06
    assert miss["with"] < miss["without"]


@pytest.mark.parametrize("given", ["calibration", "calibration/intrinsics",
                                   "calibration/extrinsics"])  # fmt: skip
def test_pose2sims_folders_are_told_apart_at_once(refused, few, tmp_path, given):
    """Each camera's images of its lens have names of their own: as one set they say nothing."""
    folder = tmp_path / "calibration"
    for kind, start in (("intrinsics", "int"), ("extrinsics", "ext")):
        for camera in few.iterdir():
            shutil.copytree(camera, folder / kind / f"{start}_{camera.name}_img")
    line = refused(tmp_path / given)
    assert (
        f"{folder / 'extrinsics'} as IMAGES and --intrinsics-images {folder / 'intrinsics'}"
        in (line)
    )
    assert "called alike by --pattern, like '*_{camera}_img/{frame}.*'" in line


def test_lens_images_of_no_camera(refused, few, tmp_path):
    shutil.copytree(few / "cam00", tmp_path / "lenses" / "left")
    line = refused(few, "--intrinsics-images", tmp_path / "lenses")
    assert "found left, expected names of cameras as in the images: cam00, cam01, cam02" in line


def test_lenses_known_beforehand(run_tool, taken, calibrated, tmp_path):
    done = run_tool(
        "calibrate_rig", taken[1], "--target", TARGET, "-o", tmp_path / "rig.yaml",
        "--square-pixels", "--fixed-center", "--common-lens", "cam00,cam02",
        "--cache", calibrated[1] / "cache",
    )  # fmt: skip
    assert done.exit_code == 0, (done.stderr, done.exception)
    rig = load_rig(tmp_path / "rig.yaml")
    for camera in rig:
        K = camera.camera_matrix
        assert K[0, 0] == K[1, 1]
        np.testing.assert_array_equal(K[:2, 2], (np.array(camera.image_size) - 1) / 2)
    np.testing.assert_array_equal(rig[0].camera_matrix, rig[2].camera_matrix)
    assert rig[0].distortion == rig[2].distortion
    assert rig[0].camera_matrix[0, 0] != rig[1].camera_matrix[0, 0]


def test_lenses_of_cameras_with_other_names(run_tool, taken, calibrated, tmp_path):
    cameras = (replace(c, name=n) for c, n in zip(taken[0], ("a", "b", "cam02"), strict=True))
    save_rig(Rig(tuple(cameras)), tmp_path / "lab.yaml")
    done = run_tool(
        "calibrate_rig", taken[1], "--target", TARGET, "-o", tmp_path / "rig.yaml",
        "--intrinsics", tmp_path / "lab.yaml", "--intrinsics", "cam00=a",
        "--intrinsics", "cam01=b", "--cache", calibrated[1] / "cache",
    )  # fmt: skip
    assert done.exit_code == 0, (done.stderr, done.exception)
    for camera, known in zip(load_rig(tmp_path / "rig.yaml"), taken[0], strict=True):
        np.testing.assert_array_equal(camera.camera_matrix, known.camera_matrix)


LENSES = {
    "no rig": (("--intrinsics", "cam00=a"), "--intrinsics: found 0 rigs"),
    "not mapped": (("--intrinsics", "lab.yaml"), "add --intrinsics cam00=a"),
    "no such camera": (
        ("--intrinsics", "lab.yaml", "--intrinsics", "left=a"),
        "left=a: found 'left', expected a camera of the images once: cam00, cam01, cam02",
    ),
    "no such lens": (
        ("--intrinsics", "lab.yaml", "--intrinsics", "cam00=c"),
        "cam00=c: found 'c', expected a camera of",
    ),
    "both": (
        ("--intrinsics", "lab.yaml", "--intrinsics", "cam00=a", "--intrinsics", "cam01=b",
         "--square-pixels"),
        "intrinsics: found square_pixels too",
    ),
}  # fmt: skip


@pytest.mark.parametrize("fault", LENSES)
def test_what_is_said_of_lenses_must_agree(refused, taken, tmp_path, monkeypatch, fault):
    monkeypatch.chdir(tmp_path)
    cameras = (replace(c, name=n) for c, n in zip(taken[0], ("a", "b", "cam02"), strict=True))
    save_rig(Rig(tuple(cameras)), tmp_path / "lab.yaml")
    options, words = LENSES[fault]
    assert words in refused(taken[1], *options)


def test_images_named_otherwise_give_the_same_rig(run_tool, few, tmp_path):
    """Side by side, and by a pattern: the figures are those of one folder a camera."""
    flat, moments = tmp_path / "flat", tmp_path / "moments"
    flat.mkdir()
    for path in sorted(few.rglob("*.*")):
        camera, frame = path.parent.name, path.stem
        (moments / f"run_{frame}").mkdir(parents=True, exist_ok=True)
        shutil.copy(path, flat / f"{camera}_{frame}{path.suffix}")
        shutil.copy(path, moments / f"run_{frame}" / f"{camera}{path.suffix}")
    suffix = path.suffix
    rigs = []
    for folder, more in (
        (few, ()),
        (flat, ()),
        (moments, ("--pattern", f"run_{{frame}}/{{camera}}{suffix}")),
    ):
        options = ("--target", TARGET, "--model", "none", "-o", tmp_path / "out" / "rig.yaml")
        done = run_tool("calibrate_rig", folder, *options, *more)
        assert done.exit_code == 0, (done.stderr, done.exception)
        rigs.append(load_rig(tmp_path / "out" / "rig.yaml"))
    for rig in rigs[1:]:
        assert rig.names == rigs[0].names
        for one, other in zip(rig, rigs[0], strict=True):
            np.testing.assert_array_equal(one.camera_matrix, other.camera_matrix)
            np.testing.assert_array_equal(one.t, other.t)


def test_an_unknown_order_of_colours_is_refused(run_tool, few, tmp_path):
    done = run_tool(
        "calibrate_rig", few, "--target", TARGET, "--bayer", "XYZ", "-o", tmp_path / "rig.yaml"
    )
    assert done.exit_code == 2
    assert "bayer: found 'XYZ', expected one of RGGB" in done.stderr
