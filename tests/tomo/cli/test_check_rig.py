import json

import cv2
import numpy as np
import pytest
import trimesh
import yaml

import rigs
from phantoms import create
from rigs import ring, save_rig
from rigs.rig import Volume
from tomo import VoxelGrid
from tomo.simulation import simulate_images

VOLUME = Volume((16, 40, 16), 1.0)


@pytest.fixture
def rig_file(tmp_path):
    rig = ring(
        7, distance=900.0, image_size=(40, 60), footprint=1.0, pitch_degrees=4.0, volume=VOLUME
    )
    save_rig(rig, tmp_path / "rig.yaml")
    return tmp_path / "rig.yaml"


def edited(path, change):
    data = yaml.safe_load(path.read_text())
    change(data)
    path.write_text(yaml.safe_dump(data))
    return path


def test_a_good_rig_is_called_good_with_its_figures(run_tool, rig_file):
    done = run_tool("check_rig", rig_file, "--no-time", "--json")
    assert done.exit_code == 0, done.stderr
    report = json.loads(done.stdout)
    assert report["assessment"] == "good"
    assert report["views"] == {"least": 7, "median": 7.0, "most": 7, "unseen": 0.0}
    resolved = report["resolved_wavelength"]
    # the ring is pitched by 4 degrees: its lines are a little longer than the box is wide
    assert resolved["worst"] == pytest.approx(2 * 16 * np.sin(np.pi / 14), rel=0.07)
    assert 2 < resolved["half"] < resolved["nine_tenths"] < resolved["worst"]
    assert abs(resolved["worst_direction"][1]) < 0.4  # flat layers upright between the views
    assert report["pixel_in_voxels"] == pytest.approx(1, rel=0.02)
    assert 0.1 < report["ray_miss"] < 0.3
    assert list(report["cameras"]) == [f"cam{k:02d}" for k in range(7)]
    assert report["cameras"]["cam03"]["blur_in_pixels"] is None
    assert report["estimate"]["voxels"] == 16 * 40 * 16
    assert report["estimate"]["seconds"] is None
    assert "rig: good." in done.stderr


def test_the_camera_responsible_is_named_in_plain_words(run_tool, rig_file):
    def turn(data):
        entry = data["cameras"][4]
        entry["R"] = (np.diag([-1.0, 1, -1]) @ entry["R"]).tolist()
        entry["t"] = (np.diag([-1.0, 1, -1]) @ entry["t"]).tolist()

    done = run_tool("check_rig", edited(rig_file, turn), "--no-time")
    assert done.exit_code == 0, done.stderr
    assert "fault: cam04: nothing of the volume in the image: turned away from it" in done.stderr
    assert "rig: not usable." in done.stderr
    rows = [line.split() for line in done.stdout.splitlines() if line.startswith("cam0")]
    assert [row[0] for row in rows] == [f"cam{k:02d}" for k in range(7)]
    assert "0.0%" in rows[4]
    assert "100.0%" in rows[3]


def test_a_rig_in_metres_about_a_grid_in_millimetres_is_reported(run_tool, rig_file):
    def in_metres(data):
        for entry in data["cameras"]:
            entry["t"] = [value / 1000 for value in entry["t"]]

    done = run_tool("check_rig", edited(rig_file, in_metres), "--no-time")
    assert done.exit_code == 0
    assert "t seems to be in metres, the grid millimetres (times 1000)" in done.stderr


def test_time_and_memory_are_estimated(run_tool, rig_file):
    done = run_tool("check_rig", rig_file, "--json", "--iterations", 50)
    estimate = json.loads(done.stdout)["estimate"]
    assert estimate["projector"] == "stored"
    assert 7 * 16 * 40 < estimate["rays"] < 7 * 40 * 60
    assert estimate["segments"] > 10 * estimate["rays"]
    assert estimate["bytes"] > 8 * estimate["segments"]
    whole = estimate["trace_seconds"] + 50 * estimate["iteration_seconds"]
    assert estimate["seconds"] == pytest.approx(whole)
    assert 0 < estimate["iteration_seconds"] < 10


def test_maps_go_to_all_three_kinds_of_file(run_tool, rig_file, tmp_path):
    outs = [tmp_path / f"maps.{suffix}" for suffix in ("png", "html", "glb")]
    options = [part for out in outs for part in ("-o", out)]
    done = run_tool("check_rig", rig_file, "--no-time", *options)
    assert done.exit_code == 0, done.stderr
    assert cv2.imread(str(outs[0])).std() > 10
    page = outs[1].read_text(encoding="utf-8")
    for words in (
        "map: details",
        "map: views",
        "Is this rig good enough?",
        "Assessment: good",
    ):
        assert words in page
    assert any(name.startswith("map: views") for name in trimesh.load(outs[2]).geometry)


def test_a_preset_and_a_grid_of_ones_own(run_tool):
    grid = ("--grid", "10x10x10", "--spacing", "2", "--center", "0,5,0")
    done = run_tool("check_rig", rigs.preset_names()[0], *grid, "--no-time", "--json")
    assert done.exit_code == 0, done.stderr
    assert json.loads(done.stdout)["voxel"] == pytest.approx(2)


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("none.yaml",), "none.yaml: no such rig file"),
        (("RIG", "--grid", "3x4"), "--grid: found '3x4'"),
        (("RIG", "--pixel-accuracy", "0"), "--pixel-accuracy: found 0"),
        (("RIG", "-o", "x.eps"), "expected one of .png"),
        (("RIG", "--images", "nowhere", "-o", "OUT.html"), "nowhere: no such folder"),
        (("RIG", "--images", "nowhere"), "--images: found nowhere without a page, expected an .h"),
    ],
)
def test_bad_input_is_one_line_and_exit_code_2(run_tool, rig_file, tmp_path, arguments, words):
    names = {"RIG": rig_file, "OUT.html": tmp_path / "out.html"}
    done = run_tool("check_rig", *(names.get(a, a) for a in arguments), "--no-time")
    assert done.exit_code == 2
    assert words in done.stderr
    assert done.stderr.count("\n") == 1
    assert not (tmp_path / "out.html").exists()


def test_a_rig_without_a_volume_needs_a_grid(run_tool, tmp_path):
    rig = ring(3, distance=900.0, image_size=(40, 60), footprint=1.0)
    save_rig(rig, tmp_path / "bare.yaml")
    done = run_tool("check_rig", tmp_path / "bare.yaml", "--no-time")
    assert done.exit_code == 2
    assert "--grid and --spacing" in done.stderr
    assert "the cameras' axes meet at --center 0,0,0" in done.stderr


def test_the_point_where_axes_meet_is_offered_as_the_centre(run_tool, tmp_path):
    rig = ring(3, distance=900.0, image_size=(40, 60), footprint=1.0)
    save_rig(rig.transformed(np.eye(3), np.array([500.0, 20, -300])), tmp_path / "far.yaml")
    grid = ("--grid", "10x10x10", "--spacing", "2", "--no-time", "--json")
    done = run_tool("check_rig", tmp_path / "far.yaml", *grid)
    assert done.exit_code == 0, (done.stderr, done.exception)
    first = json.loads(done.stdout)["findings"][0]
    assert first["level"] == "warning"
    assert first["text"].endswith("meet at 500,20,-300: try --center 500,20,-300")
    for center in ("500,20,-300", "0,0,0"):  # one given is taken as it is
        done = run_tool("check_rig", tmp_path / "far.yaml", *grid, "--center", center)
        assert "try --center" not in done.stdout + done.stderr


@pytest.mark.parametrize("name", ["scan", "scan/scan.yaml"])
def test_a_scan_says_where_the_volume_is(run_tool, tmp_path, name):
    """Its own grid, be it named by its folder or its file, and not that of its rig."""
    grid = VoxelGrid((10, 20, 10), 1.0)
    rig = ring(5, distance=200.0, image_size=(24, 30), footprint=1.0, volume=VOLUME)
    simulate_images(rig, create("jet", 1, grid.extent), grid).save(tmp_path / "scan")
    done = run_tool("check_rig", tmp_path / name, "--no-time", "--json")
    assert done.exit_code == 0, done.stderr
    assert json.loads(done.stdout)["estimate"]["voxels"] == 10 * 20 * 10
    drawn = run_tool("visualize_rig", tmp_path / name, "-o", tmp_path / "rig.glb", "--json")
    assert drawn.exit_code == 0, drawn.stderr
    again = run_tool(
        "simulate",
        "--rig",
        tmp_path / name,
        "--phantom",
        "jet",
        "-o",
        tmp_path / "other",
        "--json",
    )
    assert json.loads(again.stdout)["grid"]["shape"] == [10, 20, 10]


def test_a_scan_file_is_known_by_its_format_whatever_it_is_called(run_tool, tmp_path):
    grid = VoxelGrid((4, 6, 4), 1.0)
    rig = ring(3, distance=200.0, image_size=(8, 10), footprint=1.0)
    simulate_images(rig, create("jet", 1, grid.extent), grid).save(tmp_path)
    renamed = (tmp_path / "scan.yaml").rename(tmp_path / "run7.yaml")
    done = run_tool("check_rig", renamed, "--no-time", "--json")
    assert done.exit_code == 0, done.stderr
    assert json.loads(done.stdout)["estimate"]["voxels"] == 4 * 6 * 4


def test_it_says_how_small_a_fault_images_would_tell(run_tool, rig_file):
    done = run_tool("check_rig", rig_file, "--no-time", "--json", "--noise", 0.01)
    assert done.exit_code == 0, done.stderr
    limits = json.loads(done.stdout)["detection_limits"]
    assert list(limits["cameras"]) == [f"cam{k:02d}" for k in range(7)]
    one = limits["cameras"]["cam03"]
    assert 0.02 < one["shift"] < 2
    assert 0.002 < one["gain"] < 0.2
    noisy = json.loads(
        run_tool("check_rig", rig_file, "--no-time", "--json", "--noise", 0.1).stdout
    )
    assert noisy["detection_limits"]["cameras"]["cam03"]["gain"] > one["gain"]
    words = run_tool("check_rig", rig_file, "--no-time", "--noise", 0.01)
    assert "Smallest faults" in words.stdout


def test_limits_ask_for_noise_that_can_be(run_tool, rig_file):
    done = run_tool("check_rig", rig_file, "--no-time", "--noise", 2)
    assert done.exit_code == 2
    assert "--noise: found 2, expected a fraction between 0 and 1" in done.stderr
