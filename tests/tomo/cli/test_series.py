import json

import numpy as np
import pytest
import tifffile

from rigs import ring, save_rig
from tomo import VoxelGrid
from tomo.operators import LinearSystem


@pytest.fixture(scope="module")
def films(tmp_path_factory, nothing_sought):
    """Return the arguments for a rig and the films of a blob that moves along."""
    folder = tmp_path_factory.mktemp("films")
    grid = VoxelGrid((10, 10, 10), 1.0)
    rig = ring(4, distance=200.0, image_size=(20, 20), footprint=0.8, pitch_degrees=10.0)
    system = LinearSystem.from_rig(rig, grid, skip=False)
    x, y, z = np.moveaxis(grid.centers(), -1, 0)
    films = {name: [] for name in rig.names}
    for time in range(5):
        volume = np.exp(-((x - 0.4 * time + 1) ** 2 + y**2 + (z + 1) ** 2) / 4)
        images = system.images(system.projector @ volume.ravel().astype(np.float32))
        for name, image in zip(rig.names, images, strict=True):
            films[name].append(np.round(image * 8000).astype(np.uint16))
    for name, pages in films.items():
        tifffile.imwrite(folder / f"{name}.tif", np.array(pages), photometric="minisblack")
    save_rig(rig, folder / "rig.yaml")
    return [
        "--rig", folder / "rig.yaml", "--images", folder, "--grid", "10x10x10", "--spacing", "1",
        *nothing_sought,
    ]  # fmt: skip


@pytest.fixture(scope="module")
def made(films, run_tool, tmp_path_factory, choose_quickly):
    out = tmp_path_factory.mktemp("made") / "out.zarr"
    asked = ("--frames", "0:5:2", "--hold-out", "cam01", "-o", out, "--json")
    with choose_quickly():
        done = run_tool("reconstruct", *films, *asked)
    assert done.exit_code == 0, done.stderr
    return out, done


def test_films_become_a_store_and_its_figures(made):
    out, done = made
    report = json.loads(done.stdout)
    assert report["store"] == str(out)
    assert report["frames"] == report["complete"] == 3
    assert report["held_out"]["cam01"]["psnr"] > 40
    assert "held out cam01, mean: psnr" in done.stderr
    assert report["answer"]["not_explained"] == 0
    assert sum(report["verdict"]["frames"].values()) == 3
    assert report["verdict"]["sentence"] in done.stderr.splitlines()
    assert report["watched"] == report["left_out"] == []
    page = out.with_name("out_report.html")
    assert report["page"] == str(page)
    assert report["answer"]["sentence"] in page.read_text("utf-8")
    for stage in ("tracing", "smoothness 3 of 3", "3 in 0:0"):
        assert stage in done.stderr


def test_the_same_command_again_changes_nothing(made, films, run_tool):
    out, _ = made
    before = {path: path.stat().st_mtime_ns for path in out.rglob("*") if path.is_file()}
    done = run_tool("reconstruct", *films, "--frames", "0:5:2", "--hold-out", "cam01", "-o", out)
    assert done.exit_code == 0
    assert "3 of 3 frames" in done.stderr
    assert before == {path: path.stat().st_mtime_ns for path in out.rglob("*") if path.is_file()}


def test_exports_are_written(made, run_tool, tmp_path):
    out, _ = made
    done = run_tool("export", out, "--to", "pvd", "-o", tmp_path / "flame.pvd", "--json")
    assert done.exit_code == 0, done.stderr
    assert json.loads(done.stdout)["frames"] == 3
    names = sorted(path.name for path in (tmp_path / "flame_frames").iterdir())
    assert names == ["frame_000000.vti", "frame_000002.vti", "frame_000004.vti"]
    done = run_tool("export", out, "--to", "npz", "--frames", "1:2", "-o", tmp_path / "volumes")
    assert [path.name for path in (tmp_path / "volumes").iterdir()] == ["frame_000002.npz"]


def test_a_store_is_drawn_as_a_page_that_plays(made, run_tool, tmp_path):
    done = run_tool("visualize-volume", made[0], "-o", tmp_path / "film.html", "--json")
    assert done.exit_code == 0, done.stderr
    assert json.loads(done.stdout)["frames"] == [0, 2, 4]
    assert "All 3 frames." in (tmp_path / "film.html").read_text("utf-8")


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("--frames", "0:9", "-o", "o.zarr"), "frames: found '0:9', expected numbers up to 5"),
        (("--frames", ":", "-o", "out"), "-o: found"),
        (("--frames", ":", "--workers", "0", "-o", "o.zarr"), "workers: found 0, expected"),
        (("--workers", "2", "-o", "out"), "--workers: found 2, expected it with --frames"),
        (("--frames", "0:5:2", "-o", "STORE"), "hold_out: found ['cam01'] in the store, and now"),
    ],
)
def test_wrong_requests_are_one_line(
    films, made, refused, tmp_path, monkeypatch, arguments, words
):
    monkeypatch.chdir(tmp_path)
    given = [made[0] if one == "STORE" else one for one in arguments]
    assert words in refused("reconstruct", *films, *given)


@pytest.mark.parametrize(
    ("verb", "arguments", "words"),
    [
        ("export", ("none.zarr", "--to", "pvd", "-o", "a.pvd"), "none.zarr: no such store"),
        ("export", ("STORE", "--to", "gif", "-o", "a.gif"), "to: found 'gif', expected one"),
        ("export", ("STORE", "--to", "netcdf", "-o", "a.mp4"), "a.mp4: suffix: found '.mp4', ex"),
        ("export", ("STORE", "--to", "npz", "--frames", "0:7", "-o", "a"), "numbers up to 3"),
        ("visualize-volume", ("STORE", "-o", "a.glb"), "found '.glb' with a store"),
    ],
)
def test_what_a_store_is_not_for(made, refused, tmp_path, monkeypatch, verb, arguments, words):
    monkeypatch.chdir(tmp_path)
    given = [made[0] if one == "STORE" else one for one in arguments]
    assert words in refused(verb, *given)
