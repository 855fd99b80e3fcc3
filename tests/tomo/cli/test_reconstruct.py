import json
import re
import shutil
import subprocess
import sys
from pathlib import Path

import cv2
import numpy as np
import pytest
import tifffile

from phantoms import create
from rigs import ring
from rigs.formats.transforms import save_transforms
from tomo import VoxelGrid, load_scan
from tomo.io import read_volume
from tomo.report.outcome_files import Drawn
from tomo.simulation import simulate_images

pytestmark = pytest.mark.usefixtures("quick_choices")

TOOL = Path(__file__).parents[3] / "tools" / "reconstruct.py"
GRID = VoxelGrid((8, 14, 8), (1.0, 1.0, 1.2), (10.0, 0.0, -3.0))
VOLUMES = ("volume.npz", "volume.vti", "volume.nrrd")
HALF_WIDTHS = {"half_width.npz", "half_width.vti", "half_width.nrrd"}
PICTURES = {"rig.png", "flame.png", "convergence.png", "difference.png", "intervals.png"}
PAGES = {"report.html", "rig.html", "flame.html"}


@pytest.fixture(scope="module")
def scan(tmp_path_factory):
    folder = tmp_path_factory.mktemp("simulated") / "scan"
    rig = ring(5, distance=150.0, image_size=(18, 24), footprint=0.9, center=GRID.center)
    field = create("jet", 2, GRID.extent, GRID.center)
    simulate_images(rig, field, GRID, supersample=2, refine=2).save(folder)
    return folder


@pytest.fixture(scope="module")
def done(run_tool, scan, tmp_path_factory):
    """Return the folder and the result of one whole run."""
    out = tmp_path_factory.mktemp("done") / "deep" / "out"
    options = ("--hold-out", "cam02", "--compare", "sirt:3", "--json")
    result = run_tool("reconstruct", scan, *options, "-o", out)
    assert result.exit_code == 0, result.stderr
    return out, result


def test_everything_promised_is_there_and_nothing_else(done):
    out, _ = done
    names = {path.name for path in out.iterdir()}
    assert names == {*VOLUMES, *HALF_WIDTHS, *PICTURES, *PAGES, "report.json"}
    last = (out / "report.json").stat().st_mtime_ns
    assert all(path.stat().st_mtime_ns <= last for path in out.iterdir())
    for name in PICTURES:
        image = cv2.imread(str(out / name))
        assert min(image.shape[:2]) > 200
        assert image.std() > 5
    page = (out / "report.html").read_text("utf-8")
    for source in re.findall(r"""<(?:img|script|iframe)[^>]*?\ssrc=["']([^"']{0,40})""", page):
        assert source.startswith("data:")
    assert not re.findall(r"<link[^>]*href=[\"']?(?!data:)", page)
    assert page.count("data:image/png;base64,") >= len(PICTURES)


def test_the_volumes_are_equal_and_on_the_grid(done):
    out, _ = done
    loaded = [read_volume(out / name) for name in VOLUMES]
    for data, grid, unit in loaded:
        np.testing.assert_array_equal(data, loaded[0][0])
        assert grid.shape == GRID.shape
        np.testing.assert_allclose(grid.lower, GRID.lower, atol=1e-9)
        np.testing.assert_allclose(grid.spacing, GRID.spacing, rtol=1e-12)
        assert unit == "mm"
    with np.load(out / "volume.npz", allow_pickle=False) as archive:
        assert set(archive) == {"data", "origin", "spacing", "length_unit", "value_unit"}


def test_the_report_is_printed_written_and_true(done, scan):
    out, result = done
    report = json.loads(result.stdout)
    assert report == json.loads((out / "report.json").read_text("utf-8"))
    truth, _, _ = read_volume(load_scan(scan).truth)
    data = read_volume(out / "volume.npz")[0].astype(np.float64)
    cosine = np.vdot(data, truth) / np.linalg.norm(data) / np.linalg.norm(truth)
    assert report["quality"]["cosine_distance"] == pytest.approx(1 - cosine, abs=1e-6)
    assert report["quality"]["cosine_distance"] < 0.05
    assert list(report["held_out"]) == ["cam02"]
    assert report["held_out"]["cam02"]["psnr"] > 25
    (other,) = report["comparisons"]
    assert other["method"] == "sirt"
    assert set(other["held_out"]["cam02"]) == set(report["held_out"]["cam02"])
    assert other["held_out"]["cam02"]["psnr"] < report["held_out"]["cam02"]["psnr"]


def test_the_summary_is_on_stderr_one_line_a_fact(done):
    out, result = done
    lines = result.stderr.splitlines()
    assert f"open {out / 'report.html'}" in lines
    report = json.loads((out / "report.json").read_text())
    assert next(iter(report)) == "answer"
    said = [*report["warnings"], f"{report['method']}: relative residual"]
    answer = lines.index(report["answer"]["sentence"])
    assert all(any(one in line for line in lines[answer + 1 :]) for one in said)
    (held_out,) = [line for line in lines if line.startswith("held out cam02: psnr ")]
    peak = report["peak"]
    assert re.search(r"psnr [\d.]+ dB, ssim ", held_out)
    assert f"peak {peak['value']:.4g} {peak['unit']} (brightest measured pixel)" in held_out
    assert re.search(r"cameras used: psnr [\d.]+ to [\d.]+ dB\)", held_out)
    assert re.search(rf"background [\d.e-]+ {peak['unit']} fitted: psnr [\d.]+ dB", held_out)
    page = (out / "report.html").read_text("utf-8")
    assert page.count(f"{peak['value']:.4g} {peak['unit']}") >= 2  # below the PSNR and the SSIM
    assert report["verdict"]["sentence"] in lines
    assert lines[-1].startswith("open ")
    table = [" ".join(line.split()) for line in lines]
    head = table.index("method held-out psnr (dB) held-out ssim nrmse residual seconds")
    own, other = table[head + 1 : head + 3]
    assert own.split()[0] == report["method"]
    assert float(other.split()[1]) == pytest.approx(
        report["comparisons"][0]["held_out"]["cam02"]["psnr"], rel=1e-3
    )


def test_a_run_that_is_interrupted_as_it_writes_leaves_the_volume(
    run_tool, scan, quick, tmp_path, monkeypatch
):
    options = (*quick, "--pictures", "-o", tmp_path / "out")
    (tmp_path / "out").mkdir()
    (tmp_path / "out" / "report.json").write_text("{}")  # of an earlier run

    def fail(*_):
        raise KeyboardInterrupt

    monkeypatch.setattr("tomo.report.ahead.drawn", lambda *_: Drawn())
    monkeypatch.setattr("tomo.report.outcome_files.write_pictures", fail)
    assert run_tool("reconstruct", scan, *options).exit_code == 130
    left = {path.name for path in (tmp_path / "out").iterdir()}
    assert left == {*VOLUMES, "preview.npz", "preview.json", "preview.png"}


def test_a_picture_of_an_earlier_run_does_not_stay(run_tool, scan, quick, tmp_path):
    options = (*quick, "-o", tmp_path)
    (tmp_path / "difference.png").write_bytes(b"from a truth, which this run has not")
    (tmp_path / "mine.png").write_bytes(b"")
    other = ("--lower", "6,-7,-8", "--upper", "14,7,2", "--grid", "4x7x4")
    assert run_tool("reconstruct", scan, *options, *other).exit_code == 0
    assert not (tmp_path / "difference.png").exists()
    assert (tmp_path / "mine.png").exists()
    assert read_volume(tmp_path / "volume.vti")[1].shape == (4, 7, 4)


def test_images_of_a_transforms_json_that_lie_elsewhere(run_tool, refused, scan, quick, tmp_path):
    path, loaded = tmp_path / "poses" / "transforms.json", load_scan(scan)
    save_transforms(loaded.rig, path)
    text = path.read_text().replace('"file_path": "images/', '"file_path": "D:\\\\shots\\\\')
    for name, image in loaded.frames[0].images.items():
        suffix = Path(image).suffix
        text = text.replace(f"\\\\{name}.png", f"\\\\{name}\\\\{Path(image).stem}{suffix}")
    path.write_text(text)
    box = ("--grid", "6x8x6", "--spacing", "1.5")
    arguments = ("reconstruct", path, *box, *quick, "-o", tmp_path / "out")
    words = "expected a path inside the scan folder, or --images FOLDER"
    assert words in refused(*arguments)
    done = run_tool(*arguments, "--images", scan / "images", "--json")
    assert done.exit_code == 0, done.stderr
    assert set(json.loads(done.stdout)["views"]) == set(loaded.rig.names)


def test_options_reach_the_run(run_tool, scan, tmp_path):
    options = (
        "--grid", "4x7x4", "--spacing", "2,2,2.4", "--center", "10,0,-3", "--method", "mart",
        "--iterations", "3", "--seed", "7", "--no-skip", "--scale", "2", "--supersample", "2",
        "--tracer", "reference", "--hold-out", "cam00", "--hold-out", "cam04", "--no-screen",
    )  # fmt: skip
    done = run_tool("reconstruct", scan, *options, "--no-pictures", "--json", "-o", tmp_path)
    assert done.exit_code == 0, done.stderr
    report = json.loads(done.stdout)
    expected = {
        "method": "mart", "iterations": 3, "seed": 7, "skip": False, "screen": False,
        "supersample": 2, "tracer": "reference", "hold_out": ["cam00", "cam04"],
    }  # fmt: skip
    assert report["scan"]["scale"] == 2
    assert report["scan"]["grid"] == {
        "shape": [4, 7, 4], "spacing": [2.0, 2.0, 2.4], "center": [10.0, 0.0, -3.0]
    }  # fmt: skip
    assert {key: report["settings"][key] for key in expected} == expected
    (of_truth,) = report["warnings"]
    assert of_truth.startswith("truth.npz: the truth is on another grid: no quality figures. ")
    assert report["rays"] == 3 * 9 * 12 * 2**2


def test_a_reconstruction_can_be_simulated_again(run_tool, done, scan, tmp_path):
    rig, volume = scan / "rig.yaml", done[0] / "volume.nrrd"
    options = ("--rig", rig, "--phantom", volume, "--supersample", "2")
    again = run_tool("simulate", *options, "-o", tmp_path / "again")
    assert again.exit_code == 0, again.stderr
    seen, first = load_scan(tmp_path / "again").images(), load_scan(scan).images()
    assert np.linalg.norm(np.subtract(seen, first)) < 0.3 * np.linalg.norm(first)


def test_in_a_process_of_its_own(scan, quick, tmp_path):
    command = [sys.executable, TOOL, scan, "-o", tmp_path, *quick, "--json"]
    done = subprocess.run(command, capture_output=True, text=True, timeout=120, check=False)
    assert done.returncode == 0, done.stderr
    assert json.loads(done.stdout)["method"] == "sirt"
    assert "Traceback" not in done.stderr


@pytest.fixture(scope="module")
def report_of(run_tool, quick):
    """Return a function that runs a short reconstruction and returns its report."""

    def run(out, *arguments):
        options = (*quick, "--iterations", "8", "--json", "-o", out)
        result = run_tool("reconstruct", *arguments, *options)
        assert result.exit_code == 0, (result.stderr, result.exception)
        return json.loads(result.stdout)

    return run


@pytest.mark.parametrize(
    ("layout", "pattern"),
    [
        ("{camera}/{camera}_{frame}.tif", ()),
        ("{camera}.tif", ()),
        ("shot{frame}/{camera}-a.tif", ("--pattern", "shot{frame}/{camera}-*.tif")),
    ],
)
def test_images_are_found_in_any_layout_or_by_a_pattern(
    scan, report_of, tmp_path, layout, pattern
):
    for camera in load_scan(scan).rig.names:
        path = tmp_path / "images" / layout.format(camera=camera, frame="0001")
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes((scan / "images" / camera / "frame_000.tif").read_bytes())
    box = ("--grid", "8x14x8", "--spacing", "1,1,1.2", "--center", "10,0,-3")
    given = ("--rig", scan / "rig.yaml", "--images", tmp_path / "images")
    report_of(tmp_path / "a", *given, *box, *pattern)
    report_of(tmp_path / "b", scan)
    one, other = (read_volume(tmp_path / name / "volume.npz")[0] for name in "ab")
    np.testing.assert_array_equal(one, other)


def test_names_that_fit_no_layout_are_refused_with_the_pattern_to_write(scan, refused, tmp_path):
    for camera in load_scan(scan).rig.names:
        path = tmp_path / "images" / f"run3{camera}x_0001_raw.tif"
        path.parent.mkdir(exist_ok=True)
        path.write_bytes((scan / "images" / camera / "frame_000.tif").read_bytes())
    given = ("--rig", scan / "rig.yaml", "--images", tmp_path / "images", "-o", tmp_path / "out")
    assert "--pattern 'run3{camera}x_{frame}_raw.tif'" in refused("reconstruct", *given)
    words = "camera cam00: pattern: found no image whose name fits '{camera}.tif'"
    assert words in refused("reconstruct", *given, "--pattern", "{camera}.tif")


def test_one_colour_of_a_mosaic(report_of, tmp_path):
    """Colours of other gains spoil nothing, and the pixels' own rays are those traced."""
    rig = ring(5, distance=150.0, image_size=(48, 64), footprint=0.35, center=GRID.center)
    field = create("jet", 2, GRID.extent, GRID.center)
    simulate_images(rig, field, GRID, supersample=1, refine=2).save(tmp_path / "whole")

    def error(*options):
        return report_of(tmp_path / "out", tmp_path / "whole", *options)["quality"]["nrmse"]

    green = ("--bayer", "rggb", "--channel", "g")
    whole_sensor, grey_light = error(), error(*green)
    factors = np.tile([[0.5, 1.0], [1.0, 0.25]], (32, 24)).astype(np.float32)  # RGGB
    for camera in rig.names:
        path = tmp_path / "whole" / "images" / camera / "frame_000.tif"
        tifffile.imwrite(path, tifffile.imread(path) * factors)
    assert error(*green) == grey_light < 1.25 * whole_sensor
    # a quarter of the light: not the red pixels
    assert error("--bayer", "bggr", "--channel", "r") > 2 * grey_light


def test_orientation_tags_are_noted(scan, report_of, tmp_path):
    shutil.copytree(scan, tmp_path / "scan")
    for camera in ("cam00", "cam03"):
        path = tmp_path / "scan" / "images" / camera / "frame_000.tif"
        image = tifffile.imread(path)
        tifffile.imwrite(path, image, photometric="minisblack", extratags=[(274, "H", 1, 4, True)])
    report = report_of(tmp_path / "out", tmp_path / "scan")
    (note,) = [line for line in report["warnings"] if "orientation" in line]
    assert note.startswith("cameras cam00, cam03: an orientation tag (4)")
    plain = report_of(tmp_path / "plain", scan)
    assert not [line for line in plain["warnings"] if "orientation" in line]
    one, other = (read_volume(tmp_path / n / "volume.npz")[0] for n in ("out", "plain"))
    np.testing.assert_array_equal(one, other)
