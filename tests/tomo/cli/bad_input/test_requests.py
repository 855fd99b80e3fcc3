"""What is asked for and cannot be: one line, exit code 2, nothing half-written."""

import json
import sys

import psutil
import pytest

BOX = ("--grid", "6x10x6", "--spacing", "1")


@pytest.fixture
def turn_away(scan, edit):
    """Return a function that lets cameras look past the volume."""

    def turn(*cameras):
        def change(rig):
            for camera in rig["cameras"]:
                if camera["name"] in cameras:
                    camera["t"] = [1e5, 0.0, 100.0]

        edit(scan / "rig.yaml", change)

    return turn


def test_a_volume_no_camera_sees(refused, scan, tmp_path):
    line = refused("reconstruct", scan, "--center", "1000,0,0", "-o", tmp_path / "out")
    assert f"{scan / 'scan.yaml'}: grid from (997, -5, -3) to (1003, 5, 3) mm" in line
    assert "no usable pixel of cam00, cam01, cam02 sees it" in line
    assert "meet near (0, 0, 0)" in line


@pytest.mark.parametrize("options", [(), ("--hold-out", "cam01", "--hold-out", "cam02")])
def test_one_blind_camera_is_a_warning_in_the_report(
    run_tool, turn_away, scan, quick, tmp_path, options
):
    turn_away("cam01")
    out = tmp_path / "out"
    done = run_tool("reconstruct", scan, *quick, *options, "-o", out)
    assert done.exit_code == 0, done.stderr
    warning = "camera cam01: none of its usable pixels sees the volume"
    assert done.stderr.count(warning) == 1
    warnings = json.loads((out / "report.json").read_text())["warnings"]
    assert sum(line.startswith(warning) for line in warnings) == 1


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (("--method", "art", "--device", "cuda"), "device: found 'cuda', expected cpu or auto"),
        (("--method", "wernet-paper", "--wernet-settings", "none.yaml"), "none.yaml: no such"),
        (("--scale", "13"), "camera cam00: scale: found 13, expected at most 12"),
        (("--no-skip", "--carving", "3"), "carving: found 3.0 where nothing is left out"),
        (("--grid", "3x4"), "--grid: found '3x4'"),
        (("--lower", "0,0,0"), "--lower and --upper: found --lower, expected both"),
        (("--lower", "0,0,0", "--upper", "1,1,1", "--spacing", "1"), "--upper, --spacing, exp"),
        (("--lower", "1,0,0", "--upper", "0,1,1"), "with upper above lower"),
        (("--rig", "rig.yaml"), "SCAN: expected either a scan, or --rig"),
        (("--hold-out", "cam99"), "hold_out: found camera 'cam99'"),
        (("--hold-out", "cam01", "--center", "1e7,0,0"), "no usable pixel of cam00, cam02"),
    ],
)
def test_a_wrong_option(refused, scan, tmp_path, options, words):
    assert words in refused("reconstruct", scan, *options, "-o", tmp_path / "out")


def test_a_gpu_without_the_extra(refused, scan, quick, tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "cupy", None)
    for tool, *first in (
        ("reconstruct", scan, *quick),
        ("reconstruct", scan, *quick[:4], "--frames", ":"),
        ("simulate", "--rig", scan, "--phantom", "jet", *BOX),
    ):
        out = tmp_path / ("out.zarr" if "--frames" in first else "out")
        line = refused(tool, *first, "--device", "cuda", "-o", out)
        assert line.startswith("error: device: found 'cuda', expected one that can be used: GPU: ")


@pytest.mark.parametrize("more", [(), ("--grid", "", "--spacing", "1")])
def test_no_grid_anywhere(refused, scan, tmp_path, more):
    given = ("--rig", scan / "rig.yaml", "--images", scan / "images", "-o", tmp_path / "out")
    assert "--grid and --spacing: expected both" in refused("reconstruct", *given, *more)


def test_held_out_cameras_that_see_nothing(refused, turn_away, scan, tmp_path):
    turn_away("cam01")
    line = refused("reconstruct", scan, "--hold-out", "cam01", "-o", tmp_path / "out")
    assert "hold_out: nothing to compare with" in line


@pytest.mark.parametrize(
    "options", [(), ("--method", "wernet-paper"), ("--no-skip", "--projector", "on-the-fly")]
)
def test_a_grid_that_would_not_fit(refused, scan, tmp_path, options):
    fine = ("--grid", "30000x50000x30000", "--spacing", "0.0002", *options)
    line = refused("reconstruct", scan, *fine, "-o", tmp_path / "out")
    assert "grid 30000x50000x30000: would take about 2,88" in line  # 64 bytes a voxel: 2880 TB
    free = psutil.virtual_memory().available / 1e9
    assert float(line.split("found ")[1].split(" GB")[0]) == pytest.approx(free, rel=0.3)


@pytest.mark.parametrize(
    ("tool", "out", "words"),
    [
        ("reconstruct", "file/out", "file: is a file, expected a folder"),
        ("simulate", "file", "file: is a file, expected a folder"),
        ("visualize_rig", "file/o.png", "file: is a file, expected a folder"),
        ("visualize_rig", "folder.png", "folder.png: is a folder, expected a file"),
        ("reconstruct", "o" * 300, "File name too long"),
    ],
)
def test_an_output_that_cannot_be_written(refused, scan, tmp_path, tool, out, words):
    (tmp_path / "file").write_text("mine")
    (tmp_path / "folder.png").mkdir()
    given = ("--rig", scan, "--phantom", "jet") if tool == "simulate" else (scan,)
    assert words in refused(tool, *given, "-o", tmp_path / out)
