"""What is asked for and cannot be: one line, exit code 2, nothing half-written."""

import json
import sys
from pathlib import Path

import psutil
import pytest
import torch

CAMERAS = ("cam00", "cam01", "cam02")
QUICK = ("--method", "sirt", "--iterations", "2")
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


OPTIONS = {
    "frame": (("--frame", "foo"), "frame: found 'foo', expected one of frame_000"),
    "held-out": (
        ("--hold-out", "cam99"),
        "hold_out: found camera 'cam99', expected one of cam00, cam01, cam02",
    ),
    "all held out": (
        [word for name in CAMERAS for word in ("--hold-out", name)],
        "hold_out: found all 3 cameras, expected at least one left",
    ),
    "device for entries": (
        ("--method", "art", "--device", "cuda"),
        "device: found 'cuda', expected cpu or auto for method art: it goes through the matrix's",
    ),
    "settings of a classic": (
        ("--method", "sirt", "--wernet-settings", "paper"),
        "wernet_settings: found paper, expected none for method sirt: only wernet and wernet-",
    ),
    "settings of the other form": (
        ("--method", "wernet", "--wernet-settings", "paper-text"),
        "paper-text.yaml: 'inputs': found a field that WernetSettings has not, expected one of",
    ),
    "settings that are not there": (
        ("--method", "wernet-paper", "--wernet-settings", "none.yaml"),
        "none.yaml: no such settings file, and none that comes along; those are paper, paper-",
    ),
    "scale": (("--scale", "13"), "camera cam00: scale: found 13, expected at most 12"),
    "blur ray by ray": (
        ("--blur", "2", "--method", "art"),
        "blur: found 2.0, expected 0 for method art: it goes ray by ray",
    ),
    "carving of nothing": (
        ("--no-skip", "--carving", "3"),
        "carving: found 3.0 where nothing is left out",
    ),
    "grid": (("--grid", "3x4"), "--grid: found '3x4'"),
    "lower": (("--lower", "0,0,0"), "--lower and --upper: found --lower, expected both"),
    "lower, upper and spacing": (
        ("--lower", "0,0,0", "--upper", "1,1,1", "--spacing", "1"),
        "--lower and --upper: found --lower, --upper, --spacing, expected both",
    ),
    "order": (("--lower", "1,0,0", "--upper", "0,1,1"), "with upper above lower"),
    "--rig beside": (("--rig", "rig.yaml"), "SCAN: expected either a scan, or --rig"),
}


@pytest.mark.parametrize("fault", OPTIONS)
def test_a_wrong_option(refused, scan, tmp_path, fault):
    options, words = OPTIONS[fault]
    line = refused("reconstruct", scan, *options, "-o", tmp_path / "out")
    assert words in line


@pytest.mark.skipif(torch.cuda.is_available(), reason="CUDA is here")
def test_cuda_without_cuda(refused, scan, tmp_path):
    options = ("--method", "wernet-paper", "--device", "cuda")
    line = refused("reconstruct", scan, *options, "-o", tmp_path / "out")
    assert "device: found 'cuda', expected one that this PyTorch can use" in line


def test_a_gpu_without_the_extra(refused, scan, tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "cupy", None)
    ending = "GPU: found no CuPy, expected it: pip install 'flametomo[gpu]'"
    for tool, *first in (
        ("reconstruct", scan, *QUICK),
        ("reconstruct", scan, *QUICK, "--frames", ":"),
        ("simulate", "--rig", scan, "--phantom", "jet", *BOX),
    ):
        out = tmp_path / ("out.zarr" if "--frames" in first else "out")
        line = refused(tool, *first, "--device", "cuda", "-o", out)
        assert line == f"error: device: found 'cuda', expected one that can be used: {ending}"


def test_no_grid_anywhere(refused, scan, tmp_path):
    given = ("--rig", scan / "rig.yaml", "--images", scan / "images", "-o", tmp_path / "out")
    line = refused("reconstruct", *given)
    assert "--grid and --spacing: expected both" in line
    line = refused("reconstruct", *given, "--grid", "", "--spacing", "1")
    assert "--grid and --spacing: expected both" in line


def test_a_volume_no_camera_sees(refused, scan, tmp_path):
    line = refused("reconstruct", scan, "--center", "1000,0,0", "-o", tmp_path / "out")
    assert f"{scan / 'scan.yaml'}: grid from (997, -5, -3) to (1003, 5, 3) mm" in line
    assert "no usable pixel of cam00, cam01, cam02 sees it" in line
    assert "meet near (0, 0, 0)" in line


def test_a_volume_that_only_the_held_out_camera_sees(refused, turn_away, scan, tmp_path):
    turn_away("cam00", "cam02")
    line = refused("reconstruct", scan, "--hold-out", "cam01", "-o", tmp_path / "out")
    assert "no usable pixel of cam00, cam02 sees it" in line
    assert "held out: cam01" in line


def test_held_out_cameras_that_see_nothing(refused, turn_away, scan, tmp_path):
    turn_away("cam01")
    line = refused("reconstruct", scan, "--hold-out", "cam01", "-o", tmp_path / "out")
    assert "hold_out: nothing to compare with" in line
    assert "no usable pixel of cam01 sees it" in line


@pytest.mark.parametrize("options", [(), ("--hold-out", "cam01", "--hold-out", "cam02")])
def test_one_blind_camera_is_a_warning_in_the_report(run_tool, turn_away, scan, tmp_path, options):
    turn_away("cam01")
    out = tmp_path / "out"
    done = run_tool("reconstruct", scan, *QUICK, *options, "--no-pictures", "-o", out)
    assert done.exit_code == 0, done.stderr
    warning = "camera cam01: none of its usable pixels sees the volume"
    assert done.stderr.count(warning) == 1
    warnings = json.loads((out / "report.json").read_text())["warnings"]
    assert sum(line.startswith(warning) for line in warnings) == 1


@pytest.mark.parametrize(
    "options",
    [
        (),
        ("--method", "wernet-paper"),
        ("--refine-cameras", "none", "--no-screen"),
        ("--no-skip", "--projector", "on-the-fly"),
        ("--hold-out", "cam00"),  # two views are left: nothing is aligned
    ],
    ids=" ".join,
)
def test_a_grid_that_would_not_fit(refused, scan, tmp_path, options):
    fine = ("--grid", "30000x50000x30000", "--spacing", "0.0002", *options)
    line = refused("reconstruct", scan, *fine, "-o", tmp_path / "out")
    assert "grid 30000x50000x30000: would take about 2,88" in line  # 64 bytes a voxel: 2880 TB
    free = psutil.virtual_memory().available / 1e9
    assert float(line.split("found ")[1].split(" GB")[0]) == pytest.approx(free, rel=0.3)
    assert "would fit" in line


@pytest.mark.parametrize("place", ["out", "file/out"])
@pytest.mark.parametrize("tool", ["reconstruct", "simulate"])
def test_an_output_folder_that_is_a_file(refused, scan, tmp_path, tool, place):
    (tmp_path / Path(place).parts[0]).write_text("mine")
    arguments = {
        "reconstruct": (scan,),
        "simulate": ("--rig", scan / "rig.yaml", "--phantom", "jet", *BOX),
    }[tool]
    line = refused(tool, *arguments, "-o", tmp_path / place)
    assert f"{tmp_path / Path(place).parts[0]}: is a file, expected a folder" in line


def test_an_output_picture_below_a_file_or_at_a_folder(refused, scan, tmp_path):
    (tmp_path / "file").write_text("mine")
    for tool, given in (("visualize_rig", scan), ("visualize_volume", scan / "truth.npz")):
        line = refused(tool, given, "-o", tmp_path / "file" / "o.png")
        assert f"{tmp_path / 'file'}: is a file, expected a folder" in line
    (tmp_path / "o.png").mkdir()
    line = refused("visualize_rig", scan, "-o", tmp_path / "o.png")
    assert "o.png: is a folder, expected a file" in line


@pytest.mark.parametrize("tool", ["reconstruct", "check_rig"])
def test_an_output_name_that_no_file_system_holds(refused, scan, tmp_path, tool):
    name = "o" * 300 + (".html" if tool == "check_rig" else "")
    line = refused(tool, scan, "-o", tmp_path / name)
    assert f"{tmp_path / name}: File name too long" in line


@pytest.mark.parametrize(
    ("tool", "arguments", "words"),
    [
        ("reconstruct.py", ("{}/scan", "--hold-out", "cam99", "-o", "{}/o"), "'cam99'"),
        ("reconstruct.py", ("{}/scan", "--center", "1e7,0,0", "-o", "{}/o"), "sees it"),
        ("visualize_volume.py", ("{}/scan/rig.yaml", "-o", "{}/o.png"), "rig.yaml"),
    ],
)
def test_in_a_process_of_its_own(refused_by_a_process, scan, tmp_path, tool, arguments, words):
    assert words in refused_by_a_process(tool, *(a.format(tmp_path) for a in arguments))
