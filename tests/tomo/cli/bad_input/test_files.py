"""Every kind of bad file, through the commands: one line, exit code 2, nothing half-written."""

import numpy as np
import pytest
import tifffile

from rigs import load_rig
from rigs.formats.transforms import save_transforms

BOX = ("--grid", "6x10x6", "--spacing", "1")


def _image(scan):
    return scan / "images" / "cam01" / "frame_000.tif"


def _spoil(path):
    pixels = tifffile.imread(path)
    pixels[3, 4] = np.nan
    tifffile.imwrite(path, pixels)


@pytest.mark.parametrize("tool", ["reconstruct", "simulate"])
def test_a_unit_that_volume_files_cannot_hold(refused, edit, scan, tmp_path, tool):
    edit(scan / "rig.yaml", lambda rig: rig.update(length_unit="my unit"))
    arguments = {
        "reconstruct": (scan,),
        "simulate": ("--rig", scan / "rig.yaml", "--phantom", "jet", *BOX),
    }[tool]
    line = refused(tool, *arguments, "-o", tmp_path / "out")
    assert "length_unit: found 'my unit', expected one word" in line


@pytest.mark.parametrize("tool", ["reconstruct", "simulate", "visualize_rig"])
def test_a_wrong_camera(refused, edit, scan, tmp_path, tool):
    edit(scan / "rig.yaml", lambda rig: rig["cameras"][1]["R"].reverse())
    given = ("--rig", scan / "rig.yaml", "--phantom", "jet") if tool == "simulate" else (scan,)
    out = tmp_path / ("out.png" if tool == "visualize_rig" else "out")
    assert f"{scan / 'rig.yaml'}: camera cam01: R: " in refused(tool, *given, "-o", out)


@pytest.mark.parametrize(
    ("damage", "words"),
    [
        (lambda path: path.unlink(), "no such image file"),
        (lambda path: tifffile.imwrite(path, np.zeros((18, 13), np.float32)), "13 x 18 pixels"),
        (_spoil, "found 1 NaN or infinite pixels, the first at row 3, column 4"),
        (lambda path: path.write_bytes(path.read_bytes()[:100]), "not a readable image"),
    ],
    ids=["missing", "size", "NaN", "cut"],
)
@pytest.mark.parametrize("options", [(), ("--hold-out", "cam01")], ids=["used", "held out"])
def test_a_wrong_image(refused, scan, tmp_path, damage, words, options):
    damage(_image(scan))
    line = refused("reconstruct", scan, *options, "-o", tmp_path / "out")
    assert words in line
    assert str(_image(scan)) in line
    assert "camera cam01" in line


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda d: d["frames"][0]["images"].pop("cam01"), "camera cam01: found no image"),
        (lambda d: d["frames"][0]["images"].update(cam99="x.tif"), "found camera 'cam99'"),
        (lambda d: d.update(rig="/rig.yaml"), "rig: found '/rig.yaml', expected a path"),
    ],
)
def test_a_wrong_scan_file(refused, edit, scan, tmp_path, change, words):
    edit(scan / "scan.yaml", change)
    line = refused("reconstruct", scan, "-o", tmp_path / "out")
    assert line.startswith(f"error: {scan / 'scan.yaml'}: ")
    assert words in line


@pytest.mark.parametrize("fraction", [0, 0.6])
@pytest.mark.parametrize("name", ["scan.yaml", "rig.yaml", "truth.npz", "transforms.json"])
def test_empty_and_truncated_files(refused, scan, tmp_path, name, fraction):
    path = scan / name
    if name == "transforms.json":
        save_transforms(load_rig(scan / "rig.yaml"), path)
    path.write_bytes(path.read_bytes()[: int(fraction * path.stat().st_size)])
    given = path if name == "transforms.json" else scan
    line = refused("reconstruct", given, "-o", tmp_path / "out")
    # a scan.yaml may end anywhere and still be YAML: then the missing part is named
    assert str(path) in line or name == "scan.yaml"
    if name == "truth.npz":
        assert str(path) in refused("visualize_volume", path, "-o", tmp_path / "o.html")
        shown = ("--volume", path, "-o", tmp_path / "o.glb")
        assert str(path) in refused("visualize_rig", scan, *shown)


def test_an_earlier_output_survives_bad_input(refused, scan, quick, tmp_path):
    out = tmp_path / "out"
    out.mkdir()
    for name in ("report.json", "volume.npz", "difference.png"):
        (out / name).write_text(f"an earlier {name}")
    _spoil(_image(scan))
    refused("reconstruct", scan, *quick, "-o", out)  # compares every file below tmp_path
