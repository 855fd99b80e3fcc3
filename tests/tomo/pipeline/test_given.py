"""What a notebook gives to `tomo.reconstruct`, what it shows, and what it says of mistakes."""

import numpy as np
import pytest

import phantoms
import tomo
from rigs import ring, save_rig
from rigs.recordings import write_image
from tomo.cli.console import _with_options

GRID = tomo.VoxelGrid((6, 8, 6), 1.0)
RIG = ring(5, distance=150.0, image_size=(16, 20), footprint=0.7)
ASKED = {
    "method": "sirt",
    "iterations": 3,
    "uncertainty": 0,
    "screen": False,
    "refine_cameras": "none",
}
ASKED |= {"fit_gain": False, "fit_absorption": False}


@pytest.fixture(scope="module")
def made():
    return tomo.simulate(RIG, phantoms.create("jet", 2, GRID.extent), GRID)


@pytest.fixture(scope="module")
def expected(made):
    arrays = tomo.Scan.from_arrays(RIG, dict(zip(RIG.names, made.images(), strict=True)), GRID)
    return tomo.reconstruct(arrays, options=tomo.Options(**ASKED))


def test_folders_arrays_and_keywords_give_the_same_volume(made, expected, tmp_path):
    images = dict(zip(RIG.names, made.images(), strict=True))
    folder = made.save(tmp_path / "scan").parent
    for name, image in images.items():
        write_image(tmp_path / "images" / f"{name}.tif", image)
    save_rig(RIG, tmp_path / "rig.yaml")
    for found in (
        tomo.reconstruct(str(folder), **ASKED),
        tomo.reconstruct(folder, options=tomo.Options(**ASKED | {"iterations": 9}),
                         method="sirt", iterations=3),
        tomo.reconstruct(images, GRID, rig=RIG, **ASKED),
        tomo.reconstruct(tmp_path / "images", GRID, rig=tmp_path / "rig.yaml", **ASKED),
    ):  # fmt: skip
        np.testing.assert_array_equal(found.volume, expected.volume)
    film = {name: np.stack([image, image]) for name, image in images.items()}
    store = tomo.reconstruct_series(film, tmp_path / "f.zarr", GRID, rig=RIG, frames="1:", **ASKED)
    assert store.n_frames == 1


def test_what_is_shown_of_a_value_is_short(made, expected):
    many = ring(200, distance=150.0, image_size=(16, 20), footprint=0.7)
    for value in (
        RIG,
        many,
        many[:0],
        made,
        expected,
        GRID,
        tomo.Scan(RIG, expected_frames(made)),
    ):
        lines = repr(value).splitlines()
        assert len(lines) <= 6
        assert max(map(len, lines)) < 200
    assert repr(RIG) == "<Rig: 5 cameras (cam00, cam01, ..., cam04), 16 x 20 pixels, in mm>"
    assert "sirt" in repr(expected)
    assert "full scales per mm" in repr(expected) or "image units per mm" in repr(expected)


def expected_frames(made):
    images = dict(zip(RIG.names, made.images(), strict=True))
    return tuple(tomo.Frame(f"frame_{number:05d}", images) for number in range(500))


@pytest.mark.parametrize(
    ("asked", "words"),
    [
        ({"hold_out": "cam77"}, "hold_out: found camera 'cam77'"),
        ({"hold_out": ",".join(RIG.names)}, "hold_out: found all 5 cameras"),
        ({"refine_cameras": "nominal"}, "refine_cameras: found no nominal camera"),
        ({"refine_cameras": "cam77"}, "refine_cameras: found camera 'cam77'"),
        ({"frame": "x"}, "frame: found 'x'"),
        ({"methods": "sirt"}, "options: found 'methods', did you mean method?"),
        ({"rig": RIG}, "rig: found one, expected none beside a scan's own"),
        ({"grid": tomo.VoxelGrid((4, 4, 4), 1.0, (900.0, 0, 0))}, "grid from (898"),
    ],
)
def test_mistakes_in_memory_name_arguments(made, asked, words):
    images = dict(zip(RIG.names, made.images(), strict=True))
    scan = tomo.Scan.from_arrays(RIG, images, GRID)
    with pytest.raises(ValueError, match=r"found|grid") as caught:
        tomo.reconstruct(scan, **(ASKED | asked))
    assert str(caught.value).startswith(words)
    assert "--" not in str(caught.value)


def test_a_scan_without_a_grid_or_a_rig_says_which_argument(made):
    images = dict(zip(RIG.names, made.images(), strict=True))
    with pytest.raises(ValueError, match=r"^grid: found none .*grid=VoxelGrid"):
        tomo.reconstruct(images, rig=RIG)
    with pytest.raises(ValueError, match=r"^rig: found none, expected the rig of the images"):
        tomo.reconstruct(images, GRID)
    with pytest.raises(ValueError, match=r"^scan: found int, expected a Scan"):
        tomo.reconstruct(7, GRID)


def test_commands_name_options_in_the_same_messages():
    said = "screen=False reconstructs all the same; skip_bad=True, or channel='g'"
    assert (
        _with_options(said) == "--no-screen reconstructs all the same; --skip-bad, or --channel g"
    )
