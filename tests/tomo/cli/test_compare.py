import json

import numpy as np
import pytest

from tomo.grid import VoxelGrid
from tomo.io import VolumeFilm, write_volume

GRID = VoxelGrid((8, 10, 9), 1.0, (0.0, 1.0, 2.0))
DATA = np.exp(-((GRID.centers() - GRID.center) ** 2).sum(axis=-1) / 9).astype(np.float32)


@pytest.fixture
def files(tmp_path):
    """Return an outcome's folder, a volume file, a bare array and a film of two frames."""
    (tmp_path / "out").mkdir()
    write_volume(tmp_path / "out/volume.npz", 1.1 * DATA, GRID, value_unit="counts per mm")
    write_volume(tmp_path / "a.nrrd", DATA, GRID, value_unit="counts per mm")
    np.save(tmp_path / "array.npy", DATA)
    film = VolumeFilm.create(tmp_path / "film.zarr", GRID, [0.0, 0.1])
    for number in range(2):
        film.write(number, (1 + number) * DATA)
    return tmp_path


def test_an_outcome_beside_a_file(run_tool, files):
    page = files / "page.html"
    done = run_tool("compare", files / "a.nrrd", files / "out", "-o", page, "--json")
    assert done.exit_code == 0, done.stderr
    found = json.loads(done.stdout)
    assert found["nrmse"] == pytest.approx(0.1, rel=1e-5)
    assert found["total_ratio"] == pytest.approx(1.1, rel=1e-5)
    assert found["b"]["name"] == "out"
    assert found["page"] == str(page)
    assert "out beside a.nrrd" in page.read_text("utf-8")
    assert "NRMSE: 0.1\n" in done.stderr


def test_frames_of_films_and_of_stores_and_bare_arrays(run_tool, files, film_store, volumes):
    film = files / "film.zarr"
    done = run_tool("compare", film, film, "--frame-a", 0, "--frame-b", 1, "--json")
    assert json.loads(done.stdout)["total_ratio"] == pytest.approx(2)
    assert json.loads(done.stdout)["b"]["name"] == "film.zarr, frame 1"
    store = film_store.path
    done = run_tool("compare", store, store, "--frame-a", 2, "--frame-b", 3, "--json")
    expected = volumes[3].sum() / volumes[2].sum()
    assert json.loads(done.stdout)["total_ratio"] == pytest.approx(expected, rel=1e-5)
    given = ("--spacing", "1", "--center", "0,1,2")
    done = run_tool("compare", files / "a.nrrd", files / "array.npy", *given, "--json")
    assert json.loads(done.stdout)["nrmse"] == 0


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("a.nrrd", "none"), "none: no such file or folder"),
        (("a.nrrd", "."), "volume.npz: no such volume file"),
        (("a.nrrd", "array.npy"), "array.npy: spacing: missing"),
        (("a.nrrd", "out", "--spacing", "1"), "--spacing, --center, --length-unit: found"),
        (("a.nrrd", "film.zarr"), "film.zarr: found 2 frames, expected one: --frame-b N names it"),
        (("film.zarr", "a.nrrd", "--frame-a", 2), "--frame-a: found 2, expected 0 to 1"),
        (("a.nrrd", "a.nrrd", "--frame-b", 0), "--frame-b: found 0, expected it with a film"),
        (("a.nrrd", "a.nrrd", "-o", "page.png"), "page.png: suffix: found '.png', expected .html"),
    ],
)
def test_bad_input_is_one_line(refused, files, monkeypatch, arguments, words):
    monkeypatch.chdir(files)
    assert words in refused("compare", *arguments)
