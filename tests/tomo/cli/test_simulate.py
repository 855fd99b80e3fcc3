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


def test_a_rig_may_be_a_scan_s(run_tool, rig, tmp_path):
    scan = tmp_path / "scan"
    arguments = ("--phantom", "jet", *BOX)
    assert run_tool("simulate", "--rig", rig, *arguments, "-o", scan).exit_code == 0
    (scan / "rig.yaml").rename(scan / "cameras.yaml")
    text = (scan / "scan.yaml").read_text().replace("rig: rig.yaml", "rig: cameras.yaml")
    (scan / "scan.yaml").write_text(text)
    done = run_tool("simulate", "--rig", scan, *arguments, "-o", tmp_path / "again", "--json")
    assert done.exit_code == 0, done.stderr
    assert json.loads(done.stdout)["cameras"] == ["front"]


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


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("--phantom", "fire", *BOX), "found 'fire', expected a volume file or one of"),
        (("--phantom", "jet"), "--grid and --spacing"),
        (("--phantom", "jet", "--grid", "3x4", "--spacing", "1"), "--grid: found '3x4'"),
        (("--phantom", "jet", "--grid", "3x4x0", "--spacing", "1"), "grid shape"),
        (("--phantom", "jet", "--grid", "3x4x5", "--spacing", "1,2"), "--spacing: found '1,2'"),
        (("--phantom", "jet", "--grid", "3x4x5", "--spacing", "nan"), "--spacing: found 'nan'"),
        (("--phantom", "jet", *BOX[:4], "--center", "-1,2"), "--center: found '-1,2'"),
        (("--phantom", "jet", *BOX, "--noise", "-1"), "noise: found -1"),
        (("--phantom", "none.vti", *BOX), "none.vti: no such volume"),
        (
            ("--phantom", "none.stl", *BOX),
            "files end in .npz, .vti, .nrrd, ",
        ),
        (("--phantom", "jet", "--grid", "90000x90000x90000", "--spacing", "1e-4"), "would fit"),
    ],
)
def test_bad_input_is_one_line_and_writes_nothing(run_tool, rig, tmp_path, arguments, message):
    done = run_tool("simulate", "--rig", rig, *arguments, "-o", tmp_path / "scan")
    assert done.exit_code == 2
    errors = [line for line in done.stderr.splitlines() if line.startswith("error: ")]
    assert len(errors) == 1
    assert message in errors[0]
    assert not (tmp_path / "scan").exists()


def test_an_unknown_rig_lists_the_presets(run_tool, tmp_path):
    done = run_tool("simulate", "--rig", "none", "--phantom", "jet", "-o", tmp_path / "scan")
    assert done.exit_code == 2
    assert "paper33_pitch" in done.stderr


def test_a_volume_in_another_unit_is_refused(run_tool, rig, tmp_path):
    write_volume(tmp_path / "flame.npz", np.ones(GRID.shape), GRID, "m")
    arguments = ("--rig", rig, "--phantom", tmp_path / "flame.npz", "-o", tmp_path / "scan")
    done = run_tool("simulate", *arguments)
    assert done.exit_code == 2
    assert "length_unit: found 'm', expected 'mm'" in done.stderr


def test_a_film_is_written_and_its_frames_are_scored(run_tool, rig, tmp_path):
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
        "-o", tmp_path / "out.zarr", "--json",
    )  # fmt: skip
    assert done.exit_code == 0, done.stderr
    assert 0 < json.loads(done.stdout)["quality"]["nrmse"] < 1.5
    assert "against the truth, mean: nrmse" in done.stderr


def test_a_frame_rate_belongs_to_a_film(run_tool, rig, tmp_path):
    done = run_tool(
        "simulate", "--rig", rig, "--phantom", "jet", *BOX, "--frame-rate", 5, "-o", tmp_path
    )
    assert done.exit_code == 2
    assert "--frame-rate: found 5.0, expected --frames with it" in done.stderr
