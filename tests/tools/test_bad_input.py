"""Every kind of bad input, through the commands: one line, exit code 2, nothing half-written."""

import json
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import psutil
import pytest
import tifffile
import torch
import yaml

from phantoms import create
from rigs import load_rig, ring
from tomo import VoxelGrid
from tomo.simulate import simulate

TOOLS = Path(__file__).parents[2] / "tools"
GRID = VoxelGrid((6, 10, 6), 1.0)
CAMERAS = ("cam00", "cam01", "cam02")
QUICK = ("--method", "sirt", "--iterations", "2")


@pytest.fixture(scope="module")
def original(tmp_path_factory):
    folder = tmp_path_factory.mktemp("original") / "scan"
    rig = ring(3, 60.0, 100.0, image_size=(12, 18), footprint=0.8)
    simulate(rig, create("blobs", 1, GRID.extent, GRID.center), GRID).save(folder)
    return folder


@pytest.fixture
def scan(original, tmp_path):
    shutil.copytree(original, tmp_path / "scan")
    return tmp_path / "scan"


@pytest.fixture
def refused(run_tool, tmp_path):
    """Return a function that runs a command on bad input and returns the line it says."""

    def run(tool, *arguments):
        before = _contents(tmp_path)
        done = run_tool(tool, *arguments)
        assert done.exit_code == 2, (done.stderr, done.exception)
        line = _the_one_line(done.stderr)
        assert done.stdout == ""
        assert _contents(tmp_path) == before
        return line

    return run


def _the_one_line(stderr):
    bars = ("reconstruct ", "simulate ")
    lines = [line for line in stderr.splitlines() if line.strip() and not line.startswith(bars)]
    assert len(lines) == 1, stderr
    assert lines[0].startswith("error: ")
    return lines[0]


def _contents(folder):
    return {path: path.read_bytes() for path in folder.rglob("*") if path.is_file()} | {
        path: None for path in folder.rglob("*") if path.is_dir()
    }


def _edit(path, change):
    data = yaml.safe_load(path.read_text("utf-8"))
    change(data)
    path.write_text(yaml.safe_dump(data), "utf-8")


def _image(scan, camera="cam01"):
    return scan / "images" / camera / "frame_000.tif"


def _turn_away(scan, *cameras):
    def change(rig):
        for camera in rig["cameras"]:
            if camera["name"] in cameras:
                camera["t"] = [1e5, 0.0, 100.0]

    _edit(scan / "rig.yaml", change)


CAMERA_FAULTS = {
    "model": (
        {"distortion": {"model": "foo", "coefficients": []}},
        "distortion.model: found 'foo', expected one of none, brown",
    ),
    "count": (
        {"distortion": {"model": "brown", "coefficients": [1, 2, 3]}},
        "distortion.coefficients: found 3 for model brown, expected 4 or 5",
    ),
    "mirrored": ({"R": [[-1, 0, 0], [0, 1, 0], [0, 0, 1]]}, "R: mirrored"),
    "skewed": ({"R": [[1, 0.1, 0], [0, 1, 0], [0, 0, 1]]}, "R: not orthonormal"),
}


@pytest.mark.parametrize("tool", ["reconstruct", "simulate", "visualize_rig"])
@pytest.mark.parametrize("fault", CAMERA_FAULTS)
def test_a_wrong_camera(refused, scan, tmp_path, tool, fault):
    fields, words = CAMERA_FAULTS[fault]
    _edit(scan / "rig.yaml", lambda rig: rig["cameras"][1].update(fields))
    arguments = {
        "reconstruct": (scan, "-o", tmp_path / "out"),
        "simulate": ("--rig", scan / "rig.yaml", "--phantom", "jet", "-o", tmp_path / "out"),
        "visualize_rig": (scan, "-o", tmp_path / "out.png"),
    }[tool]
    assert f"{scan / 'rig.yaml'}: camera cam01: {words}" in refused(tool, *arguments)


def _replace_image(pixels, **settings):
    return lambda path: tifffile.imwrite(path, pixels, **settings)


def _spoil(value):
    def spoil(path):
        pixels = tifffile.imread(path)
        pixels[3, 4] = value
        tifffile.imwrite(path, pixels)

    return spoil


def _cut(count):
    return lambda path: path.write_bytes(path.read_bytes()[:count])


IMAGE_FAULTS = {
    "missing": (Path.unlink, "no such image file"),
    "size": (
        _replace_image(np.zeros((18, 13), np.float32)),
        "found an image of 13 x 18 pixels, expected 12 x 18",
    ),
    "colour": (
        _replace_image(np.zeros((18, 12, 3), np.uint8), photometric="rgb"),
        "found a colour image",
    ),
    "NaN": (_spoil(np.nan), "found 1 NaN or infinite pixels, the first at row 3, column 4"),
    "infinite": (_spoil(-np.inf), "found 1 NaN or infinite pixels"),
    "empty": (_cut(0), "not a readable image: the file is empty"),
    "header only": (_cut(6), "not a readable image"),
    "directory cut": (_cut(100), "not a readable image"),
    "pixels cut": (_cut(-50), "truncated"),
}


@pytest.mark.parametrize("fault", IMAGE_FAULTS)
def test_a_wrong_image(refused, scan, tmp_path, fault):
    spoil, words = IMAGE_FAULTS[fault]
    spoil(_image(scan))
    # a held-out camera's image is read and checked as well
    for options in ((), ("--hold-out", "cam01")):
        line = refused("reconstruct", scan, *options, "-o", tmp_path / "out")
        assert words in line
        assert str(_image(scan)) in line
        assert "camera cam01" in line


SCAN_FAULTS = {
    "no image": (
        lambda d: d["frames"][0]["images"].pop("cam01"),
        "frame 'frame_000': camera cam01: found no image",
    ),
    "unknown camera": (
        lambda d: d["frames"][0]["images"].update(cam99="x.tif"),
        "frame 'frame_000': found camera 'cam99', expected one of the rig's: cam00, cam01",
    ),
    "image outside": (
        lambda d: d["frames"][0]["images"].update(cam01="../x.tif"),
        "frame 'frame_000': camera cam01: found '../x.tif', expected a path inside",
    ),
    "rig outside": (
        lambda d: d.update(rig="/rig.yaml"),
        "rig: found '/rig.yaml', expected a path",
    ),
    "truth outside": (lambda d: d.update(truth="../t.npz"), "truth: found '../t.npz'"),
}


@pytest.mark.parametrize("fault", SCAN_FAULTS)
def test_a_wrong_scan_file(refused, scan, tmp_path, fault):
    change, words = SCAN_FAULTS[fault]
    _edit(scan / "scan.yaml", change)
    line = refused("reconstruct", scan, "-o", tmp_path / "out")
    assert f"{scan / 'scan.yaml'}: {words}" in line


def test_a_camera_missing_from_the_rig(refused, scan, tmp_path):
    _edit(scan / "rig.yaml", lambda rig: rig["cameras"].pop(1))
    line = refused("reconstruct", scan, "-o", tmp_path / "out")
    assert "found camera 'cam01', expected one of the rig's: cam00, cam02" in line


@pytest.mark.parametrize("share", [0, 0.3, 0.6, 0.85])
@pytest.mark.parametrize("name", ["scan.yaml", "rig.yaml", "truth.npz", "transforms.json"])
def test_empty_and_truncated_files(refused, scan, tmp_path, name, share):
    if name == "transforms.json":
        (scan / name).write_text(json.dumps(_transforms(load_rig(scan / "rig.yaml"))))
    path = scan / name
    path.write_bytes(path.read_bytes()[: int(share * path.stat().st_size)])
    given = path if name == "transforms.json" else scan
    line = refused("reconstruct", given, "-o", tmp_path / "out")
    # a scan.yaml may end anywhere and still be YAML: then what is missing is told
    assert str(path) in line or name == "scan.yaml"
    if name == "transforms.json":
        assert str(path) in refused("visualize_rig", path, "-o", tmp_path / "o.png")
    if name == "truth.npz":
        assert str(path) in refused("visualize_volume", path, "-o", tmp_path / "o.html")
        told = refused("visualize_rig", scan, "--volume", path, "-o", tmp_path / "o.glb")
        assert str(path) in told


def _transforms(rig, suffix=".tif"):
    frames = []
    for camera in rig:
        pose = np.eye(4)
        pose[:3, :3] = (np.diag([1, -1, -1]) @ camera.R).T
        pose[:3, 3] = camera.position
        K, (width, height) = camera.camera_matrix, camera.image_size
        frames.append(
            {
                "file_path": f"images/{camera.name}/frame_000{suffix}",
                "transform_matrix": pose.tolist(),
                "w": width,
                "h": height,
                "fl_x": K[0, 0],
                "fl_y": K[1, 1],
                "cx": K[0, 2] + 0.5,
                "cy": K[1, 2] + 0.5,
            }
        )
    return {"camera_model": "PINHOLE", "length_unit": "mm", "frames": frames}


@pytest.mark.parametrize(
    ("fields", "words"),
    [
        ({"file_path": "../x.tif"}, "file_path: found '../x.tif', expected a path inside"),
        ({"camera_model": "FOO"}, "camera_model: found 'FOO', expected one of"),
        ({"transform_matrix": np.diag([-1, 1, 1, 1]).tolist()}, "transform_matrix: mirrored"),
        ({"w": 13}, "camera cam01: found an image of 12 x 18 pixels, expected 13 x 18"),
        ({"k1": "a"}, "k1: found 'a'"),
    ],
)
def test_a_wrong_entry_of_transforms(refused, scan, tmp_path, fields, words):
    data = _transforms(load_rig(scan / "rig.yaml"))
    data["frames"][1].update(fields)
    (scan / "transforms.json").write_text(json.dumps(data))
    box = ("--grid", "6x10x6", "--spacing", "1")
    line = refused("reconstruct", scan / "transforms.json", *box, "-o", tmp_path / "out")
    assert words in line
    assert str(scan) in line


OPTIONS = {
    "method": (("--method", "foo"), "method: found 'foo', expected one of auto, art,"),
    "frame": (("--frame", "foo"), "frame: found 'foo', expected one of frame_000"),
    "tracer": (("--tracer", "foo"), "tracer: found 'foo', expected one of march"),
    "held-out": (
        ("--hold-out", "cam99"),
        "hold_out: found camera 'cam99', expected one of cam00, cam01, cam02",
    ),
    "all held out": (
        [word for name in CAMERAS for word in ("--hold-out", name)],
        "hold_out: found all 3 cameras, expected at least one left",
    ),
    "device of a classic": (
        ("--method", "sirt", "--device", "cuda"),
        "expected cpu for method sirt: only wernet and wernet-paper run on others",
    ),
    "device of auto": (("--device", "cuda"), "device: found 'cuda', expected cpu"),
    "unknown device": (
        ("--method", "wernet-paper", "--device", "foo"),
        "device: found 'foo', expected one that this PyTorch can use",
    ),
    "unknown device of a comparison": (
        (*QUICK, "--compare", "wernet-paper:1", "--device", "foo"),
        "device: found 'foo', expected one that this PyTorch can use",
    ),
    "encoder of a classic": (
        ("--method", "sirt", "--encoder", "e.pt"),
        "encoder: found e.pt, expected none for method sirt: only wernet and wernet-paper learn",
    ),
    "encoder of auto": (
        ("--encoder", "e.pt"),
        "encoder: found e.pt, expected none for method auto",
    ),
    "frozen classic": (
        ("--method", "sirt", "--freeze-encoder"),
        "freeze_encoder: found True, expected none for method sirt",
    ),
    "frozen without encoder": (
        ("--method", "wernet", "--freeze-encoder"),
        "freeze_encoder: found no encoder to freeze, expected",
    ),
    "resumed classic": (
        ("--method", "sirt", "--resume"),
        "--resume: found it with method sirt, expected wernet",
    ),
    "resumed auto": (("--resume",), "--resume: found it with method auto, expected wernet"),
    "resumed paper": (
        ("--method", "wernet-paper", "--resume"),
        "--resume: found it with method wernet-paper, expected wernet",
    ),
    "compare unknown": (("--compare", "foo"), "compare: found 'foo', expected one of art"),
    "compare auto": (("--compare", "auto"), "compare: found 'auto', expected one of art"),
    "compare no count": (("--compare", "sirt:"), "--compare: found 'sirt:', expected METHOD"),
    "compare bad count": (("--compare", "sirt:x"), "--compare: found 'sirt:x'"),
    "compare negative": (("--compare", "sirt:-3"), "--compare: found 'sirt:-3'"),
    "compare nothing": (("--compare", ""), "--compare: found ''"),
    "time": (("--time-limit", "nan"), "time_limit: found nan, expected seconds above 0"),
    "negative time": (("--time-limit", "-1"), "time_limit: found -1"),
    "seed": (("--seed", str(2**63)), "seed: found 9223372036854775808"),
    "scale": (("--scale", "13"), "camera cam00: scale: found 13, expected at most 12"),
    "grid": (("--grid", "3x4"), "--grid: found '3x4'"),
    "lower": (("--lower", "0,0,0"), "--lower and --upper: expected both"),
    "order": (("--lower", "1,0,0", "--upper", "0,1,1"), "with upper above lower"),
    "--rig beside": (("--rig", "rig.yaml"), "SCAN: expected either a scan, or --rig"),
}


@pytest.mark.parametrize("fault", OPTIONS)
def test_a_wrong_option(refused, scan, tmp_path, fault):
    options, words = OPTIONS[fault]
    line = refused("reconstruct", scan, *options, "-o", tmp_path / "out")
    assert words in line


def _write_encoder(path, kind):
    from tomo.wernet import CorrectionEncoder, WeightEncoder, save_encoder

    save_encoder({"weights": WeightEncoder, "correction": CorrectionEncoder}[kind](), path)


ENCODER_FAULTS = {
    "missing": ("wernet", None, "no such file, expected an encoder"),
    "missing, paper": ("wernet-paper", None, "no such file, expected an encoder"),
    "text": ("wernet", "text", "found a file that cannot be read"),
    "kind": ("wernet", "weights", "kind: found an encoder of weights, expected one of correction"),
    "kind, paper": (
        "wernet-paper",
        "correction",
        "kind: found an encoder of correction, expected one of weights",
    ),
}


@pytest.mark.parametrize("fault", ENCODER_FAULTS)
def test_a_wrong_encoder(refused, scan, tmp_path, fault):
    method, content, words = ENCODER_FAULTS[fault]
    path = tmp_path / "encoder.pt"
    if content == "text":
        path.write_text("no encoder")
    elif content is not None:
        _write_encoder(path, content)
    options = ("--method", method, "--encoder", path)
    line = refused("reconstruct", scan, *options, "-o", tmp_path / "out")
    assert f"{path}: {words}" in line


@pytest.mark.parametrize("content", [b"", b"no checkpoint"])
def test_a_wrong_checkpoint(refused, scan, tmp_path, content):
    out = tmp_path / "out"
    out.mkdir()
    (out / "checkpoint.pt").write_bytes(content)
    line = refused("reconstruct", scan, "--method", "wernet", "--resume", "-o", out)
    assert f"{out / 'checkpoint.pt'}: found a file that cannot be read" in line


@pytest.mark.skipif(torch.cuda.is_available(), reason="CUDA is here")
def test_cuda_without_cuda(refused, scan, tmp_path):
    options = ("--method", "wernet-paper", "--device", "cuda")
    line = refused("reconstruct", scan, *options, "-o", tmp_path / "out")
    assert "device: found 'cuda', expected one that this PyTorch can use" in line


def test_no_grid_anywhere(refused, scan, tmp_path):
    given = ("--rig", scan / "rig.yaml", "--images", scan / "images", "-o", tmp_path / "out")
    line = refused("reconstruct", *given)
    assert "grid: found none" in line
    assert "--grid with --spacing" in line


def test_a_volume_no_camera_sees(refused, scan, tmp_path):
    line = refused("reconstruct", scan, "--center", "1000,0,0", "-o", tmp_path / "out")
    assert f"{scan / 'scan.yaml'}: grid from (997, -5, -3) to (1003, 5, 3) mm" in line
    assert "no usable pixel of cam00, cam01, cam02 sees it" in line
    assert "meet near (0, 0, 0)" in line


def test_a_volume_that_only_the_held_out_camera_sees(refused, scan, tmp_path):
    _turn_away(scan, "cam00", "cam02")
    line = refused("reconstruct", scan, "--hold-out", "cam01", "-o", tmp_path / "out")
    assert "no usable pixel of cam00, cam02 sees it" in line
    assert "held out: cam01" in line


def test_held_out_cameras_that_see_nothing(refused, scan, tmp_path):
    _turn_away(scan, "cam01")
    line = refused("reconstruct", scan, "--hold-out", "cam01", "-o", tmp_path / "out")
    assert "hold_out: nothing to judge by" in line
    assert "no usable pixel of cam01 sees it" in line


@pytest.mark.parametrize("options", [(), ("--hold-out", "cam01", "--hold-out", "cam02")])
def test_one_blind_camera_is_a_warning_in_the_report(run_tool, scan, tmp_path, options):
    _turn_away(scan, "cam01")
    out = tmp_path / "out"
    done = run_tool("reconstruct", scan, *QUICK, *options, "-o", out)
    assert done.exit_code == 0, done.stderr
    warning = "camera cam01: none of its usable pixels sees the volume"
    assert done.stderr.count(warning) == 1
    assert json.loads((out / "report.json").read_text())["warnings"].count(warning) == 1


@pytest.mark.parametrize("method", ["auto", "wernet-paper"])
def test_a_grid_that_would_not_fit(refused, scan, tmp_path, method):
    fine = ("--grid", "30000x50000x30000", "--spacing", "0.0002", "--method", method)
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
        "simulate": ("--rig", scan / "rig.yaml", "--phantom", "jet", *_BOX),
    }[tool]
    line = refused(tool, *arguments, "-o", tmp_path / place)
    assert f"{tmp_path / Path(place).parts[0]}: is a file, expected a folder" in line


_BOX = ("--grid", "6x10x6", "--spacing", "1")


def test_an_output_picture_below_a_file_or_at_a_folder(refused, scan, tmp_path):
    (tmp_path / "file").write_text("mine")
    for tool, given in (("visualize_rig", scan), ("visualize_volume", scan / "truth.npz")):
        line = refused(tool, given, "-o", tmp_path / "file" / "o.png")
        assert f"{tmp_path / 'file'}: is a file, expected a folder" in line
    (tmp_path / "o.png").mkdir()
    line = refused("visualize_rig", scan, "-o", tmp_path / "o.png")
    assert "o.png: is a folder, expected a file" in line


@pytest.mark.parametrize("tool", ["reconstruct", "simulate"])
def test_a_unit_that_volume_files_cannot_hold(refused, scan, tmp_path, tool):
    _edit(scan / "rig.yaml", lambda rig: rig.update(length_unit="my unit"))
    arguments = {
        "reconstruct": (scan,),
        "simulate": ("--rig", scan / "rig.yaml", "--phantom", "jet", *_BOX),
    }[tool]
    line = refused(tool, *arguments, "-o", tmp_path / "out")
    assert "length_unit: found 'my unit', expected one word" in line


def test_an_earlier_output_survives_bad_input(refused, scan, tmp_path):
    out = tmp_path / "out"
    out.mkdir()
    for name in ("report.json", "report.html", "volume.npz", "difference.png"):
        (out / name).write_text(f"an earlier {name}")
    _spoil(np.nan)(_image(scan))
    refused("reconstruct", scan, *QUICK, "-o", out)  # compares every file below tmp_path
    refused("reconstruct", scan, "--center", "1e7,0,0", "-o", out)


@pytest.mark.parametrize(
    ("tool", "arguments", "words"),
    [
        ("reconstruct.py", ("{}/scan", "--hold-out", "cam99", "-o", "{}/o"), "'cam99'"),
        ("reconstruct.py", ("{}/scan", "--center", "1e7,0,0", "-o", "{}/o"), "sees it"),
        ("visualize_volume.py", ("{}/scan/rig.yaml", "-o", "{}/o.png"), "rig.yaml"),
    ],
)
def test_in_a_process_of_its_own(scan, tmp_path, tool, arguments, words):
    command = [sys.executable, TOOLS / tool, *(a.format(tmp_path) for a in arguments)]
    before = _contents(tmp_path)
    done = subprocess.run(command, capture_output=True, text=True, timeout=120, check=False)
    assert done.returncode == 2
    assert words in _the_one_line(done.stderr)
    assert done.stdout == ""
    assert _contents(tmp_path) == before
