import json
import subprocess
import sys
from pathlib import Path

import cv2
import numpy as np
import pytest
import trimesh

import rigs
from tomo.grid import VoxelGrid
from tomo.io import write_volume

TOOLS = Path(__file__).parents[2] / "tools"
GRID = VoxelGrid((8, 20, 10), (1.0, 2.0, 1.5), (0.0, 1.0, 2.0))


def run(tool, *arguments):
    command = [sys.executable, str(TOOLS / tool), *map(str, arguments)]
    return subprocess.run(command, capture_output=True, text=True, timeout=120, check=False)


@pytest.fixture
def volume(tmp_path):
    data = np.exp(-((GRID.centers() - GRID.center) ** 2).sum(axis=-1) / 18).astype(np.float32)
    write_volume(tmp_path / "volume.npz", data, GRID, "mm")
    return tmp_path / "volume.npz"


def test_rig_with_a_volume_to_all_three(tmp_path, volume):
    outs = [tmp_path / f"rig.{suffix}" for suffix in ("png", "html", "glb")]
    options = [part for out in outs for part in ("-o", out)]
    done = run("visualize_rig.py", "paper11_33deg", "--volume", volume, *options)
    assert done.returncode == 0, done.stderr
    assert outs[0].read_bytes().startswith(b"\x89PNG")
    assert "cam00" in outs[1].read_text(encoding="utf-8")
    bounds = trimesh.load(outs[2]).bounds
    assert np.abs(bounds).max() == pytest.approx(5.8, rel=0.05)  # metres


@pytest.mark.parametrize("name", rigs.preset_names())
def test_every_preset_to_all_three(run_tool, tmp_path, name):
    outs = [tmp_path / f"rig.{suffix}" for suffix in ("png", "html", "glb")]
    options = [part for out in outs for part in ("-o", out)]
    done = run_tool("visualize_rig", name, *options, "--json")
    assert done.exit_code == 0, done.stderr
    told = json.loads(done.stdout)
    assert told["files"] == [str(out) for out in outs]
    assert told["cameras"] == list(rigs.preset(name).names)
    picture = cv2.imread(str(outs[0]))
    assert min(picture.shape[:2]) > 800
    assert picture.std() > 10
    page = outs[1].read_text(encoding="utf-8")
    assert all(camera in page for camera in told["cameras"])
    positions = np.array([camera.position for camera in rigs.preset(name)]) / 1000  # metres
    bounds = trimesh.load(outs[2]).bounds
    assert (bounds[0] < positions.min(axis=0) + 1e-6).all()
    assert (bounds[1] > positions.max(axis=0) - 1e-6).all()


def test_volume_to_all_three(tmp_path, volume):
    outs = [tmp_path / f"v.{suffix}" for suffix in ("png", "html", "glb")]
    options = [part for out in outs for part in ("-o", out)]
    done = run("visualize_volume.py", volume, *options)
    assert done.returncode == 0, done.stderr
    assert all(out.stat().st_size > 10_000 for out in outs)
    np.testing.assert_allclose(
        trimesh.load(outs[2]).bounds, [GRID.lower / 1e3, GRID.upper / 1e3], atol=2e-4
    )


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("paper11_33deg", "-o", "{}/a.pdf"), "expected one of .png, .html, .glb"),
        (("no_such_rig", "-o", "{}/a.png"), "no_such_rig"),
        (("paper11_33deg", "--grid", "3x4", "-o", "{}/a.png"), "--grid"),
        (("paper11_33deg", "--volume", "{}/none.npz", "-o", "{}/a.png"), "none.npz"),
    ],
)
def test_bad_input_is_one_line_and_exit_code_2(tmp_path, arguments, words):
    done = run("visualize_rig.py", *(a.format(tmp_path) for a in arguments))
    assert done.returncode == 2
    assert words in done.stderr
    assert done.stderr.count("\n") == 1
    assert list(tmp_path.iterdir()) == []


def test_volume_in_another_unit_than_the_rig_s_is_told(tmp_path, volume):
    data = np.ones(GRID.shape, np.float32)
    write_volume(tmp_path / "metres.npz", data, GRID, "m")
    done = run(
        "visualize_rig.py", "paper11_33deg", "--volume", tmp_path / "metres.npz", "-o", "x.png"
    )
    assert done.returncode == 2
    assert "length_unit: found 'm'" in done.stderr
