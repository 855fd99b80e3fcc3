"""What the README promises of the default method, at full size."""

import json

import numpy as np
import pytest

from rigs import ring
from tomo import VoxelGrid
from tomo.scan import save_scan


def test_the_demo_is_a_turbulent_flame_without_inverse_crime(run_tool, tmp_path):
    out = tmp_path / "flame"
    done = run_tool("demo", "-o", out)
    assert done.exit_code == 0, done.stderr
    assert done.stdout == ""
    quality = json.loads((out / "report.json").read_text("utf-8"))["quality"]
    assert quality["cosine_distance"] < 1e-3
    assert quality["nrmse"] < 0.05
    assert quality["total_ratio"] == pytest.approx(1, abs=0.01)
    assert (out / "scan" / "scan.yaml").is_file()
    assert "<html" in (out / "report.html").read_text("utf-8")[:200]
    assert "<html" in (out / "rig.html").read_text("utf-8")[:200]
    *_, last = done.stderr.splitlines()
    assert (
        last
        == f"Open {out / 'report.html'} for the result and {out / 'rig.html'} for the cameras."
    )
    assert [
        line
        for line in done.stderr.splitlines()
        if line.startswith("against the truth: cosine_distance ")
    ]


def test_a_real_plume_predicts_the_camera_left_out(run_tool, test_data, tmp_path):
    found = run_tool(
        "reconstruct", str(test_data / "scalarflow" / "transforms.json"), "--frame", "frame_090",
        "--hold-out", "cam02", "--scale", "6", "--grid", "64x96x64",
        "--lower", "0.0818,-0.0446,-0.4958", "--upper", "0.5727,0.6917,-0.0049",
        "--no-pictures", "--uncertainty", "0", "--peak", "1", "-o", str(tmp_path / "plume"),
        "--json",
    )  # fmt: skip
    assert found.exit_code == 0
    report = json.loads(found.stdout)
    assert report["solver"]["chosen_by"] == "auto"
    figures = report["held_out"]["cam02"]
    assert report["peak"] == {"value": 1.0, "unit": "full scales", "origin": "stated"}
    assert figures["psnr"] >= 30.5
    assert figures["ssim"] >= 0.93


def test_dark_images_are_no_accident(run_tool, tmp_path):
    """Figures that are no numbers stand as null in the report and end no command."""

    grid = VoxelGrid((6, 8, 6), 1.0)
    rig = ring(4, distance=80.0, image_size=(16, 20), footprint=0.6)
    dark = {camera.name: np.zeros((20, 16), np.float32) for camera in rig}
    save_scan(tmp_path / "scan", rig, {"f": dark}, grid=grid, truth=np.zeros(grid.shape, "f4"))
    found = run_tool(
        "reconstruct", str(tmp_path / "scan"), "--hold-out", "cam01", "-o", str(tmp_path / "out"),
        "--json",
    )  # fmt: skip
    assert found.exit_code == 0
    assert json.loads(found.stdout)["held_out"]["cam01"]["psnr"] is None
    assert "undefined" in found.stderr
