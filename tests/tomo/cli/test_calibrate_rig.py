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
from rigs.figures import Optics
from rigs.files import atomic_path
from rigs.files.rig_yaml import load_scene
from rigs.files.units import in_unit

PLAIN = ("--model", "brown4")  # the true model: choosing one takes half of a calibration
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

    monkeypatch.setattr("tomo.draw.write_calibration_page", blank)


@pytest.fixture
def calibrate(run_tool, tmp_path):
    """Return a function that runs the command and returns what it prints, or its rig."""

    def run(images, *options, out=tmp_path / "rig.yaml"):
        done = run_tool("calibrate_rig", images, "--target", TARGET, "-o", out, *options)
        assert done.exit_code == 0, (done.stderr, done.exception)
        return json.loads(done.stdout) if "--json" in options else load_rig(out), done.stderr

    return run


@pytest.fixture
def refuses(refused, tmp_path):
    """Return a function that runs the command on bad input and returns the line it says."""
    out = tmp_path / "out" / "rig.yaml"
    return lambda images, *options, target=TARGET: refused(
        "calibrate_rig", images, "--target", target, "-o", out, *options
    )


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


def test_the_cache_saves_the_search_and_changes_nothing(calibrate, taken, calibrated, tmp_path):
    _, folder, _ = calibrated
    rig, _ = calibrate(taken[1], "--cache", folder / "cache", "--report", tmp_path / "report")
    assert rig == load_rig(folder / "rig.yaml")
    assert sorted(p.name for p in (tmp_path / "report").iterdir()) == [
        "rig_calibration.html", "rig_calibration.json",
    ]  # fmt: skip


PANE = {"name": "pane", "type": "window", "point": [0, 0, 200], "normal": [0.4, 0, -0.9],
        "thickness": 10, "index": "quartz", "size": 160}  # fmt: skip


def test_a_scene_becomes_part_of_the_rig_and_its_windows_are_reported(
    calibrate, taken, calibrated, tmp_path, monkeypatch
):
    """No pane was there: what is adjusted of it contradicts what was given."""
    monkeypatch.undo()  # its page is looked at
    (tmp_path / "scene.yaml").write_text(yaml.safe_dump({"scene": {"solids": [PANE]}}), "utf-8")
    options = ("--scene", tmp_path / "scene.yaml", "--refine-window", "pane:thickness=0.2", *PLAIN)
    report, said = calibrate(taken[1], *options, "--cache", calibrated[1] / "cache", "--json")
    rig = load_rig(tmp_path / "rig.yaml")
    assert report["cameras"]["cam00"]["looked_through"] == ["pane"]
    assert report["cameras"]["cam02"]["looked_through"] == []
    found = report["windows"]["pane"]
    assert rig.scene.solids[0].thickness == pytest.approx(found["thickness"], rel=1e-5)
    assert found["thickness_change"] < 0
    assert "window pane: thickness changed by" in said
    assert "window pane" in (tmp_path / "rig_calibration.html").read_text("utf-8")


def test_lenses_that_are_given_stay_and_the_world_is_where_it_was_asked_for(
    calibrate, taken, tmp_path
):
    true, folder = taken
    lens = Optics(focal_length=35.0, f_number=4.0)
    shown = replace(true, cameras=tuple(replace(camera, optics=lens) for camera in true))
    (tmp_path / "scene.yaml").write_text(yaml.safe_dump({"scene": {"solids": [PANE]}}), "utf-8")
    save_rig(
        in_unit(shown.through(load_scene(tmp_path / "scene.yaml")), "m"), tmp_path / "true.yaml"
    )
    positions = {camera.name: np.add(camera.position, [5.0, 0, 0]).tolist() for camera in true}
    (tmp_path / "world.yaml").write_text(yaml.safe_dump(positions), "utf-8")
    options = ("--intrinsics", tmp_path / "true.yaml", "--world", tmp_path / "world.yaml")
    box = ("--grid", "10x20x10", "--spacing", "4", "--center", "5,0,0")
    rig, _ = calibrate(folder, *options, *box)
    assert (rig.volume.shape, rig.volume.center) == ((10, 20, 10), (5.0, 0.0, 0.0))
    for camera, known in zip(rig, true, strict=True):
        np.testing.assert_array_equal(camera.camera_matrix, known.camera_matrix)
        assert camera.distortion == known.distortion
        assert camera.optics.focal_length == pytest.approx(35)
        np.testing.assert_allclose(camera.position, positions[camera.name], atol=0.3)


def test_names_of_numbers_are_taken_as_they_are_written(calibrate, tmp_path, images):
    """YAML has 010 for eight."""
    for number, camera in enumerate(CAMERAS):
        (images / camera).rename(images / f"0{number + 9}")
    (tmp_path / "world.yaml").write_text(
        "09: [0, 0, 0]\n010: [0, 1, 0]\n011: [1, 0, 0]\n", "utf-8"
    )
    rig, _ = calibrate(images, "--world", tmp_path / "world.yaml", "--rescale", *PLAIN)
    assert "given positions of 09, 010, 011" in rig.world_frame


def turned_into(image, change):
    """Rewrite an image file."""
    assert cv2.imwrite(str(image), change(cv2.imread(str(image), cv2.IMREAD_GRAYSCALE)))


def test_images_that_do_not_belong_are_named_and_left_out(calibrate, images, taken):
    """One is blurred along its columns; one was taken at another moment than its name says."""
    from studies.calibration.study import true_ray_miss

    turned_into(images / "cam01" / "pose_004.png", lambda grey: cv2.blur(grey, (1, 13)))
    shutil.copy(images / "cam02" / "pose_002.png", images / "cam02" / "pose_006.png")
    rig, said = calibrate(images, *PLAIN)
    for camera, frame in (("cam01", "pose_004"), ("cam02", "pose_006")):
        assert any(camera in line and frame in line for line in said.splitlines())
    assert true_ray_miss(taken[0], rig, taken[0].volume) < 0.03


def test_lens_images_are_kept_apart_from_pose_images(calibrate, taken, few, tmp_path):
    """Three images of all cameras at once say little of their lenses; others need not be."""
    from studies.calibration.study import true_ray_miss

    lenses = tmp_path / "lenses"
    for number, camera in enumerate(CAMERAS):
        (lenses / camera).mkdir(parents=True)
        for k, path in enumerate(sorted((taken[1] / camera).iterdir())[3:]):
            shutil.copy(path, lenses / camera / f"{k + number}.png")  # other moments by name
    miss = {}
    for name, options in (("without", ()), ("with", ("--intrinsics-images", lenses))):
        rig, _ = calibrate(few, *options, *PLAIN, "--cache", tmp_path / "cache")
        miss[name] = true_ray_miss(taken[0], rig, taken[0].volume)
    assert miss["with"] < 0.06
    assert miss["with"] < miss["without"]


@pytest.mark.parametrize("given", ["calibration", "calibration/intrinsics"])
def test_pose2sims_folders_are_told_apart_at_once(refuses, few, tmp_path, given):
    """Each camera's images of its lens have names of their own: as one set they say nothing."""
    folder = tmp_path / "calibration"
    for kind, start in (("intrinsics", "int"), ("extrinsics", "ext")):
        for camera in few.iterdir():
            shutil.copytree(camera, folder / kind / f"{start}_{camera.name}_img")
    line = refuses(tmp_path / given)
    words = f"{folder / 'extrinsics'} as IMAGES and --intrinsics-images {folder / 'intrinsics'}"
    assert words in line
    assert "called alike by --pattern, like '*_{camera}_img/{frame}.*'" in line


def test_lenses_known_beforehand(calibrate, taken, calibrated):
    options = ("--square-pixels", "--fixed-center", "--common-lens", "cam00,cam02")
    rig, _ = calibrate(taken[1], *options, "--cache", calibrated[1] / "cache")
    for camera in rig:
        K = camera.camera_matrix
        assert K[0, 0] == K[1, 1]
        np.testing.assert_array_equal(K[:2, 2], (np.array(camera.image_size) - 1) / 2)
    np.testing.assert_array_equal(rig[0].camera_matrix, rig[2].camera_matrix)
    assert rig[0].distortion == rig[2].distortion
    assert rig[0].camera_matrix[0, 0] != rig[1].camera_matrix[0, 0]


def test_lenses_of_cameras_with_other_names(calibrate, taken, calibrated, tmp_path):
    cameras = (replace(c, name=n) for c, n in zip(taken[0], ("a", "b", "cam02"), strict=True))
    save_rig(Rig(tuple(cameras)), tmp_path / "lab.yaml")
    given = (tmp_path / "lab.yaml", "cam00=a", "cam01=b")
    options = [word for one in given for word in ("--intrinsics", one)]
    rig, _ = calibrate(taken[1], *options, "--cache", calibrated[1] / "cache")
    for camera, known in zip(rig, taken[0], strict=True):
        np.testing.assert_array_equal(camera.camera_matrix, known.camera_matrix)


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (("--scene", "none.yaml"), "none.yaml"),
        (("--scene", "scene.yaml"), "solid pane: index: found 0.5"),
        (("--refine-window", "pane:normal=1"), "--refine-window: found windows to adjust, exp"),
        (("--world", "world.yaml"), "world.yaml: cam00: found shape (2,), expected 3 numbers"),
        (("--intrinsics", "cam00=a"), "--intrinsics: found 0 rigs"),
        (("--intrinsics", "lab.yaml"), "add --intrinsics cam00=a"),
        (("--intrinsics", "lab.yaml", "--intrinsics", "left=a"), "left=a: found 'left', expected"),
        (("--intrinsics", "lab.yaml", "--intrinsics", "cam00=c"), "cam00=c: found 'c', expected"),
        (("--intrinsics-images", "lenses"), "found left, expected names of cameras as in the im"),
        (("--bayer", "XYZ"), "bayer: found 'XYZ', expected one of RGGB"),
        (("--grid", "3x4"), "--grid"),
        (("-o", "rig.txt"), "rig.txt: suffix: found '.txt', expected .yaml"),
    ],
)
def test_what_else_is_given_must_agree(refuses, taken, few, tmp_path, monkeypatch, options, words):
    monkeypatch.chdir(tmp_path)
    cameras = (replace(c, name=n) for c, n in zip(taken[0], ("a", "b", "cam02"), strict=True))
    save_rig(Rig(tuple(cameras)), tmp_path / "lab.yaml")
    scene = {"scene": {"solids": [PANE | {"index": 0.5}]}}
    (tmp_path / "scene.yaml").write_text(yaml.safe_dump(scene), "utf-8")
    (tmp_path / "world.yaml").write_text("cam00: [1, 2]", "utf-8")
    shutil.copytree(few / "cam00", tmp_path / "lenses" / "left")
    assert words in refuses(few, *options)


@pytest.mark.parametrize(
    ("target", "words"),
    [
        (TARGET, ("camera cam01", "pose_002.png", "320x254")),
        ("charuco:5x7:24:18:DICT_4X4_50", ("cam00", "board of 7x5 squares, not 5x7", ".png")),
        ("cuboid:3", ("target: found 'cuboid:3', expected one of",)),
    ],
)
def test_images_that_will_not_do(run_tool, few, tmp_path, target, words):
    if target == TARGET:
        turned_into(few / "cam01" / "pose_002.png", lambda image: image[:-2])
    out = tmp_path / "out" / "rig.yaml"
    done = run_tool("calibrate_rig", few, "--target", target, "-o", out)
    assert done.exit_code == 2, (done.stderr, done.exception)
    (line,) = [line for line in done.stderr.splitlines() if line.startswith("error: ")]
    assert all(one in line for one in words)
    assert not out.parent.exists() or not list(out.parent.iterdir())
