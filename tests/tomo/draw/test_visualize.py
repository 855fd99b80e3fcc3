"""Files to look at, from Python: rigs, checks and volumes, whatever a volume is given as."""

import numpy as np
import pytest

import rigs
import tomo
from tomo.draw import visualize_check, visualize_film, visualize_rig, visualize_volume
from tomo.draw.volume.visualize import volume_of
from tomo.grid import VoxelGrid
from tomo.io import data_array, write_volume

GRID = VoxelGrid((6, 8, 6), 1.0)
DATA = np.exp(-(GRID.centers() ** 2).sum(axis=-1) / 6).astype(np.float32)
RIG = rigs.ring(3, distance=60.0, image_size=(16, 20), footprint=0.6, pitch_degrees=10.0)

pytestmark = pytest.mark.usefixtures("coarse_scenes")


def test_a_volume_is_the_same_however_it_is_given(tmp_path):
    write_volume(tmp_path / "volume.npz", DATA, GRID, value_unit="u")
    array = data_array(DATA, GRID, "mm", "u")
    visualize_volume(tmp_path / "bare.glb", DATA, GRID, value_unit="u")
    visualize_volume(tmp_path / "file.glb", tmp_path / "volume.npz")
    visualize_volume(tmp_path / "xarray.glb", array)
    bare, *others = (
        (tmp_path / f"{name}.glb").read_bytes() for name in ("bare", "file", "xarray")
    )
    assert others == [bare, bare]
    assert volume_of(array).value_unit == volume_of(tmp_path / "volume.npz").value_unit == "u"


@pytest.mark.parametrize(("suffix", "begin"), [("pdf", b"%PDF"), ("svg", b"<?xml")])
def test_figures_have_the_same_bytes_each_time(tmp_path, suffix, begin):
    for name in ("first", "second"):
        visualize_volume(tmp_path / f"{name}.{suffix}", DATA, GRID, title="x")
    first, second = ((tmp_path / f"{n}.{suffix}").read_bytes() for n in ("first", "second"))
    assert first.startswith(begin)
    assert first == second


@pytest.mark.parametrize(
    ("given", "grid", "words"),
    [
        (DATA, None, "found an array of shape"),
        (DATA[1:], GRID, r"found an array of shape \(5, 8, 6\), expected the grid's"),
        (data_array(DATA, GRID), VoxelGrid((6, 8, 6), 2.0), "expected no other grid with it"),
    ],
)
def test_a_volume_has_one_grid(given, grid, words):
    with pytest.raises(ValueError, match=words):
        volume_of(given, grid)


def test_a_check_is_drawn_where_it_was_made(tmp_path):
    check = rigs.check_rig(RIG, GRID)
    visualize_check(tmp_path / "check.html", check, title="coverage <of> it")
    page = (tmp_path / "check.html").read_text("utf-8")
    assert "Is this rig good enough?" in page
    assert "<of>" not in page
    points = rigs.check.check_points(RIG, [[0, 0, 0], [1, 0, 0]], (2, 2, 2), 1.0)
    with pytest.raises(ValueError, match="check: found points without a volume"):
        visualize_check(tmp_path / "check.png", points)


def test_another_rig_and_images_are_drawn(tmp_path):
    scan = tomo.simulate(RIG, data_array(DATA, GRID))
    moved = RIG.transformed(np.eye(3), [1.0, 0.0, 0.0])
    path = tmp_path / "rig.html"
    visualize_rig(path, RIG, GRID, images=scan, other=moved, names=("old", "new"), coverage=False)
    page = path.read_text("utf-8")
    assert "new against old" in page
    assert "cam00" in page


@pytest.mark.parametrize(
    ("draw", "words"),
    [
        (lambda path: visualize_rig(path / "rig.eps", RIG), r"suffix: found '.eps', expected one"),
        (lambda path: visualize_volume(path / "a", DATA, GRID), "suffix: found '', expected one"),
        (lambda path: visualize_rig(path / "rig.png", rigs.Rig(())), "cameras: found none"),
        (lambda path: visualize_rig(path / "a.glb", RIG, volume=data_array(DATA, GRID, "m")),
         "volume: length unit: found 'm', expected 'mm'"),
        (lambda path: visualize_film(path / "a.png", path), "suffix: found '.png' with a store"),
    ],
)  # fmt: skip
def test_what_cannot_be_drawn_is_said_in_one_line(draw, words, tmp_path):
    with pytest.raises(ValueError, match=words) as caught:
        draw(tmp_path)
    assert "\n" not in str(caught.value)
    assert not list(tmp_path.iterdir())
