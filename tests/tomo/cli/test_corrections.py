"""Images with a dark level by the short way: as good as those with the dark taken off by hand."""

import json

import numpy as np
import pytest

import phantoms
import tomo
from rigs import ring, save_rig
from rigs.recordings import write_image
from tomo.cli.images import value_of
from tomo.io import read_volume

pytestmark = pytest.mark.usefixtures("quick_choices")

GRID = tomo.VoxelGrid((8, 14, 8), 1.0)
BOX = ("--grid", "8x14x8", "--spacing", "1")
DARK, FULL = 100, 4095


@pytest.fixture(scope="module")
def recorded(tmp_path_factory):
    """Return a folder of counts with a dark level of 40 to 160, dark frames, and both by hand."""
    folder = tmp_path_factory.mktemp("recorded")
    rig = ring(5, distance=150.0, image_size=(24, 32), footprint=0.7)
    made = tomo.simulate(rig, phantoms.create("jet", 2, GRID.extent), GRID, supersample=2)
    images = dict(zip(rig.names, made.images(), strict=True))
    top = max(float(image.max()) for image in images.values())
    random = np.random.default_rng(0)
    save_rig(rig, folder / "rig.yaml")
    for number, (name, image) in enumerate(images.items()):
        dark = DARK + 15 * (number - 2) * np.linspace(-1, 1, image.shape[1])
        raw = np.round(3500 * image / top + dark + random.normal(0, 2, image.shape))
        write_image(folder / "raw" / name / "0001.tif", raw.astype(np.uint16))
        by_hand = (raw - dark) / FULL
        write_image(folder / "by_hand" / name / "0001.tif", by_hand.astype(np.float32))
        for shot in range(9):
            shown = np.round(dark + random.normal(0, 2, image.shape)).astype(np.uint16)
            write_image(folder / "dark" / name / f"{shot}.tif", shown)
    return folder


def test_dark_frames_by_the_short_way_give_the_volume_of_the_dark_taken_off(
    run_tool, recorded, nothing_sought, tmp_path
):
    volumes = {}
    for images, options in (
        ("raw", ("--dark", recorded / "dark", "--bit-depth", "12")),
        ("by_hand", ()),
    ):
        out = tmp_path / images
        result = run_tool(
            "reconstruct", "--rig", recorded / "rig.yaml", "--images", recorded / images,
            *BOX, "--hold-out", "cam01", "--no-pictures", *nothing_sought, *options, "-o", out,
        )  # fmt: skip
        assert result.exit_code == 0, result.stderr
        assert json.loads((out / "report.json").read_text())["verdict"]["level"] != "red"
        volumes[images] = read_volume(out / "volume.npz")[0].astype(float)
    difference = volumes["raw"] - volumes["by_hand"]
    assert np.sqrt(np.mean(difference**2) / np.mean(volumes["by_hand"] ** 2)) < 0.03


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (("--dark", "nowhere"), "error: --dark: found 'nowhere', expected a folder or file that"),
        (("--bit-depth", "40"), "corrections.bit_depth: found 40, expected a whole number from 1"),
        (("--gain", "cam99=1.1"), "corrections.gain: found camera 'cam99', expected one of"),
        (("--dark", "100"), "100 counts of 12 bits are 0.0244"),
    ],
)
def test_what_is_no_correction_is_one_line(refused, recorded, tmp_path, options, words):
    given = ("--rig", recorded / "rig.yaml", "--images", recorded / "raw", *options)
    assert words in refused("reconstruct", *given, *BOX, "-o", tmp_path / "out")


def test_values_are_those_of_a_scan_yaml():
    assert value_of("dark", "100/4095") == 100 / 4095
    assert value_of("gain", "left=1.02,right=0.5") == {"left": 1.02, "right": 0.5}
    assert value_of("bit_depth", "12") == 12
    assert value_of("dark", "dark/{camera}.tif") == "dark/{camera}.tif"
    assert value_of("bayer", "left=rggb") == {"left": "RGGB"}
