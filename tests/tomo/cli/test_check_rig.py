import json

import cv2
import numpy as np
import pytest
import trimesh
import yaml

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
    shown = ("map: details", "map: views", "Is this rig good enough?", "Assessment: good")
    assert all(words in page for words in shown)
    assert any(name.startswith("map: views") for name in trimesh.load(outs[2]).geometry)


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


@pytest.mark.parametrize("name", ["scan", "scan/run7.yaml"])
def test_a_scan_says_where_the_volume_is(run_tool, tmp_path, name):
    """Its own grid, be it named by its folder or a file of any name, and not that of its rig."""
    grid = VoxelGrid((10, 20, 10), 1.0)
    rig = ring(5, distance=200.0, image_size=(24, 30), footprint=1.0, volume=VOLUME)
    simulate_images(rig, create("jet", 1, grid.extent), grid).save(tmp_path / "scan")
    if name != "scan":
        (tmp_path / "scan" / "scan.yaml").rename(tmp_path / name)
    done = run_tool("check_rig", tmp_path / name, "--no-time", "--json")
    assert done.exit_code == 0, done.stderr
    assert json.loads(done.stdout)["estimate"]["voxels"] == 10 * 20 * 10
    drawn = run_tool("visualize_rig", tmp_path / name, "-o", tmp_path / "rig.glb", "--json")
    assert drawn.exit_code == 0, drawn.stderr
    given = ("--rig", tmp_path / name, "--phantom", "jet", "-o", tmp_path / "other")
    again = run_tool("simulate", *given, "--json")
    assert json.loads(again.stdout)["grid"]["shape"] == [10, 20, 10]


def test_it_says_how_small_a_fault_images_would_tell(run_tool, tmp_path):
    rig_file, volume = tmp_path / "small.yaml", Volume((6, 12, 6), 1.0)
    rig = ring(
        4, distance=900.0, image_size=(14, 20), footprint=1.0, pitch_degrees=4.0, volume=volume
    )
    save_rig(rig, rig_file)
    done = run_tool("check_rig", rig_file, "--no-time", "--json", "--noise", 0.01)
    assert done.exit_code == 0, done.stderr
    limits = json.loads(done.stdout)["detection_limits"]
    assert list(limits["cameras"]) == [f"cam{k:02d}" for k in range(4)]
    one = limits["cameras"]["cam03"]
    assert 0.02 < one["shift"] < 2
    assert 0.002 < one["gain"] < 0.2
    noisy = run_tool("check_rig", rig_file, "--no-time", "--noise", 0.1)
    table = noisy.stdout.split("Smallest faults")[1]
    (row,) = [line.split() for line in table.splitlines() if line.startswith("cam03")]
    assert float(row[4]) > 100 * one["gain"]  # in percent


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("none.yaml",), "none.yaml: no such rig file"),
        (("bare.yaml",), "--grid and --spacing: expected both"),
        (("bare.yaml",), "the cameras' axes meet at --center 0,0,0"),
        (("rig.yaml", "--pixel-accuracy", "0"), "--pixel-accuracy: found '0'"),
        (("rig.yaml", "--noise", "2"), "--noise: found 2, expected a fraction between 0 and 1"),
        (("rig.yaml", "-o", "x.eps"), "expected one of .png"),
        (("rig.yaml", "--images", "nowhere", "-o", "out.html"), "nowhere: no such folder"),
        (("rig.yaml", "--images", "nowhere"), "--images: found nowhere without a page, expected"),
        (("rig.yaml", "--pattern", "{camera}.tif"), "--pattern: expected --images with it"),
    ],
)
def test_bad_input_is_one_line(refused, rig_file, tmp_path, monkeypatch, arguments, words):
    monkeypatch.chdir(tmp_path)
    save_rig(ring(3, distance=900.0, image_size=(40, 60), footprint=1.0), "bare.yaml")
    assert words in refused("check_rig", *arguments, "--no-time")
