"""What notebooks show of a reconstruction, and what it gives to xarray and to a folder."""

import json
import re
from dataclasses import replace

import numpy as np
import pytest

import rigs
import tomo
from tomo.grid import VoxelGrid

GRID = VoxelGrid((6, 9, 5), (1.0, 0.5, 1.0), (0.1, 0.2, 0.3))
RIG = rigs.ring(4, distance=100.0, image_size=(14, 16), footprint=0.6, pitch_degrees=10.0)


@pytest.fixture(scope="module")
def found(as_given):
    scan = tomo.simulate(RIG, lambda points: np.exp(-(points**2).sum(axis=-1) / 3), GRID)
    asked = {"method": "mlem", "iterations": 8, "hold_out": ("cam01",), "uncertainty": 12}
    return tomo.reconstruct(scan, options=tomo.Options(**as_given | asked))


def pictures(html):
    return re.findall(r'src="data:image/png;base64,([^"]+)"', html)


def test_a_reconstruction_shows_its_answer_its_planes_and_its_figures(found):
    html = found._repr_html_()
    assert len(html) < 200_000
    assert len(pictures(html)) == 1
    words = re.sub(r"<[^>]*>", " ", re.sub(r'src="[^"]*"', "", html))
    for part in ("6 × 9 × 5 voxels from 3 cameras", "mlem", "NRMSE", "held out cam01"):
        assert part in words
    assert found.answer.sentence.split(":")[0] in words


def test_nothing_is_loaded_and_names_are_escaped(found):
    odd = replace(found, warnings=("<script>x</script>",))
    html = odd._repr_html_()
    assert "<script" not in html
    assert "&lt;script&gt;" in html
    assert not re.search(r"https?:", html)


def test_a_verdict_leads_where_there_is_one(found, monkeypatch):
    verdict = {"level": "red", "sentence": "Red, do not use: <it>.", "reasons": [], "next": []}
    report = found.report() | {"verdict": verdict}
    monkeypatch.setattr(type(found), "report", lambda _: report)
    html = found._repr_html_()
    assert "Red, do not use: &lt;it&gt;." in html
    assert html.index("Red, do not use") < html.index("<img")


def test_the_volume_and_its_uncertainty_go_to_xarray(found):
    pytest.importorskip("xarray")
    array = found.to_xarray()
    assert VoxelGrid.from_xarray(array) == GRID
    np.testing.assert_array_equal(array.values, found.volume)
    assert array.name == "emission"
    assert array.attrs["units"] == found.value_unit
    assert array.attrs["method"] == "mlem"
    assert array.x.attrs["units"] == "mm"
    known = {"standard_deviation": found.standard_deviation, "half_width": found.half_width}
    assert known["standard_deviation"] is not None
    for name, values in known.items():
        assert (name in array.coords) == (values is not None)
        if values is not None:
            part = array.isel(x=2).coords[name]
            np.testing.assert_array_equal(part.values, values[2])
    assert set(array.reset_coords().data_vars) >= {"emission", "standard_deviation"}


def test_save_writes_what_the_command_writes(found, tmp_path):
    report = found.save(tmp_path / "out", with_pictures=False)
    assert json.loads((tmp_path / "out/report.json").read_text("utf-8"))["method"] == "mlem"
    assert report["held_out"].keys() == {"cam01"}
    data, grid, *_ = tomo.io.read_volume(tmp_path / "out/volume.vti")
    np.testing.assert_array_equal(data, found.volume)
    assert grid.shape == GRID.shape


def test_a_scan_shows_thumbnails(found, tmp_path):
    scan = tomo.simulate(RIG, lambda points: np.exp(-(points**2).sum(axis=-1) / 3), GRID)
    html = scan._repr_html_()
    assert len(pictures(html)) == 4
    assert "1 frame by 4 cameras" in html
    stored = tomo.load_scan(scan.save(tmp_path / "scan"))
    for path in (tmp_path / "scan/images").rglob("*.tif"):
        path.unlink()
    broken = stored._repr_html_()
    assert not pictures(broken)
    assert "not readable" in broken


def test_a_grid_shows_its_figures():
    html = GRID._repr_html_()
    assert "6 × 9 × 5 = 270" in html
    assert "y -2.05 to 2.45" in html
