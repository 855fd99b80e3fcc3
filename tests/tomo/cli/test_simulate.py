import json

import numpy as np
import pytest

from phantoms import create
from rigs import Camera, Rig, save_rig
from rigs.camera import look_at
from tomo import VoxelGrid, load_scan
from tomo.io import read_volume, write_volume

GRID = VoxelGrid((6, 10, 6), 0.5, (0.0, 1.0, 0.0))


@pytest.fixture
def rig(tmp_path):
    R, t = look_at((0, 0, 100.0), GRID.center)
    K = np.array([[200.0, 0, 9.5], [0, 200, 14.5], [0, 0, 1]])
    save_rig(Rig((Camera("front", (20, 30), K, R=R, t=t),)), tmp_path / "rig.yaml")
    return tmp_path / "rig.yaml"


BOX = ("--grid", "6x10x6", "--spacing", "0.5", "--center", "0,1,0")


def test_a_scan_is_written_and_described(run_tool, rig, tmp_path):
    arguments = ("--rig", rig, "--phantom", "jet", *BOX, "--supersample", 2, "--refine", 2)
    done = run_tool("simulate", *arguments, "-o", tmp_path / "scan", "--json")
    assert done.exit_code == 0, done.stderr
    result = json.loads(done.stdout)
    assert result["cameras"] == ["front"]
    assert result["settings"]["supersample"] == 2
    scan = load_scan(result["scan"])
    assert scan.grid == GRID
    assert scan.images()[0].max() == pytest.approx(result["maximum"])
    truth, grid, _ = read_volume(scan.truth)
    assert grid == GRID
    field = create("jet", 0, GRID.extent, GRID.center)
    np.testing.assert_allclose(truth.max(), field(GRID.centers()).max(), rtol=0.5)


def test_the_seed_reaches_phantom_and_noise(run_tool, rig, tmp_path):
    images = {}
    for name, seed in [("a", 1), ("b", 1), ("c", 2)]:
        arguments = ("--rig", rig, "--phantom", "homogeneous", *BOX, "--noise", 0.1)
        done = run_tool("simulate", *arguments, "--seed", seed, "-o", tmp_path / name)
        assert done.exit_code == 0, done.stderr
        assert done.stdout == ""
        images[name] = load_scan(tmp_path / name).images()[0]
    np.testing.assert_array_equal(images["a"], images["b"])
    assert np.abs(images["a"] - images["c"]).max() > 0


def test_a_volume_file_brings_its_own_grid(run_tool, rig, tmp_path):
    volume = np.random.default_rng(0).random(GRID.shape).astype(np.float32)
    write_volume(tmp_path / "flame.vti", volume, GRID, "mm")
    arguments = ("--rig", rig, "--phantom", tmp_path / "flame.vti")
    done = run_tool("simulate", *arguments, "-o", tmp_path / "scan")
    assert done.exit_code == 0, done.stderr
    scan = load_scan(tmp_path / "scan")
    truth, grid, _ = read_volume(scan.truth)
    assert grid.shape == GRID.shape
    np.testing.assert_allclose(truth, volume, rtol=1e-6)


def test_effects_reach_the_images(run_tool, rig, tmp_path):
    arguments = ("--rig", rig, "--phantom", "jet", *BOX, "--json")
    effects = (
        "--gain-spread", 0.1, "--absorption", 0.2, "--self-absorption", 0.3, "--vignetting", 0.4,
        "--aperture", 8, "--focus-distance", 90,
    )  # fmt: skip
    plain = run_tool("simulate", *arguments, "-o", tmp_path / "plain")
    done = run_tool("simulate", *arguments, *effects, "-o", tmp_path / "scan")
    assert done.exit_code == 0, done.stderr
    result = json.loads(done.stdout)
    assert result["settings"]["gains"] == {"front": 1.0}  # the mean of one
    assert result["settings"]["effects"] == {
        "gain_spread": 0.1, "absorption": 0.2, "self_absorption": 0.3, "vignetting": 0.4,
        "aperture": 8.0, "focus_distance": 90.0, "aperture_rays": 32,
    }  # fmt: skip
    assert result["maximum"] < 0.9 * json.loads(plain.stdout)["maximum"]


def test_a_film_is_written_and_its_frames_are_scored(run_tool, rig, nothing_sought, tmp_path):
    arguments = ("--rig", rig, "--phantom", "plume", *BOX, "--photons", 500, "--seed", 2)
    done = run_tool(
        "simulate", *arguments, "--frames", 3, "--frame-rate", 2000, "-o", tmp_path / "film",
        "--json",
    )  # fmt: skip
    assert done.exit_code == 0, done.stderr
    assert json.loads(done.stdout)["frames"] == 3
    scan = load_scan(tmp_path / "film")
    assert len(scan.frames) == 3
    assert scan.frame_rate == 2000
    assert np.abs(scan.images("0")[0] - scan.images("2")[0]).max() > 0
    done = run_tool(
        "reconstruct", tmp_path / "film", "--frames", ":", "--method", "mlem", "--iterations", 3,
        *nothing_sought, "-o", tmp_path / "out.zarr", "--json",
    )  # fmt: skip
    assert done.exit_code == 0, done.stderr
    assert 0 < json.loads(done.stdout)["quality"]["nrmse"] < 1.5
    assert "against the truth, mean: nrmse" in done.stderr


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("--phantom", "fire", *BOX), "found 'fire', expected a volume file or one of"),
        (("--phantom", "jet"), "--grid and --spacing"),
        (("--phantom", "jet", "--grid", "3x4x0", "--spacing", "1"), "grid shape"),
        (("--phantom", "jet", "--grid", "3x4x5", "--spacing", "1,2"), "--spacing: found '1,2'"),
        (("--phantom", "jet", *BOX[:4], "--center", "-1,2"), "--center: found '-1,2'"),
        (("--phantom", "jet", *BOX, "--noise", "-1"), "noise: found -1"),
        (("--phantom", "jet", *BOX, "--frame-rate", 5), "--frame-rate: found 5.0, expected --fra"),
        (("--phantom", "none.vti", *BOX), "none.vti: no such volume"),
        (("--phantom", "none.stl", *BOX), "files end in .npz, .vti, .nrrd, "),
        (("--phantom", "metres.npz"), "length_unit: found 'm', expected 'mm'"),
        (("--phantom", "jet", "--rig", "none"), "paper33_pitch"),
    ],
)
def test_bad_input_is_one_line(refused, rig, tmp_path, monkeypatch, arguments, words):
    monkeypatch.chdir(tmp_path)
    write_volume("metres.npz", np.ones(GRID.shape), GRID, "m")
    assert words in refused("simulate", "--rig", rig, *arguments, "-o", "scan")
