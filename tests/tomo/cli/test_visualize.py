import json
import re
from dataclasses import replace

import cv2
import numpy as np
import pytest
import trimesh

import rigs
from tomo.grid import VoxelGrid
from tomo.io import write_volume

GRID = VoxelGrid((8, 20, 10), (1.0, 2.0, 1.5), (0.0, 1.0, 2.0))


@pytest.fixture
def volume(tmp_path):
    data = np.exp(-((GRID.centers() - GRID.center) ** 2).sum(axis=-1) / 18).astype(np.float32)
    write_volume(tmp_path / "volume.npz", data, GRID, "mm")
    return tmp_path / "volume.npz"


def test_an_array_is_drawn_with_a_spacing(run_tool, tmp_path, volume):
    array, out = tmp_path / "array.npy", tmp_path / "a.glb"
    np.save(array, np.load(volume)["data"])
    grid = ("--spacing", "1,2,1.5", "--center", "0,1,2")
    done = run_tool("visualize_volume", array, *grid, "-o", out, "--json")
    assert done.exit_code == 0, done.stderr
    found = json.loads(done.stdout)["grid"]
    assert found == {"shape": [8, 20, 10], "spacing": [1, 2, 1.5], "center": [0, 1, 2]}
    expected = tmp_path / "b.glb"
    assert run_tool("visualize_volume", volume, "-o", expected).exit_code == 0
    assert out.read_bytes() == expected.read_bytes()
    done = run_tool("visualize_rig", "paper11_33deg", "--volume", array, *grid, "-o", out)
    assert done.exit_code == 0, done.stderr


def test_a_preset_with_a_volume_to_all_three(run_tool, tmp_path, volume):
    name = "paper11_33deg"
    outs = [tmp_path / f"rig.{suffix}" for suffix in ("png", "html", "glb")]
    options = [part for out in outs for part in ("-o", out)]
    done = run_tool("visualize_rig", name, "--volume", volume, *options, "--json")
    assert done.exit_code == 0, done.stderr
    result = json.loads(done.stdout)
    assert result["files"] == [str(out) for out in outs]
    assert result["cameras"] == list(rigs.preset(name).names)
    picture = cv2.imread(str(outs[0]))
    assert min(picture.shape[:2]) > 800
    assert picture.std() > 10
    page = outs[1].read_text(encoding="utf-8")
    assert all(camera in page for camera in result["cameras"])
    positions = np.array([camera.position for camera in rigs.preset(name)]) / 1000  # metres
    bounds = trimesh.load(outs[2]).bounds
    assert (bounds[0] < positions.min(axis=0) + 1e-6).all()
    assert (bounds[1] > positions.max(axis=0) - 1e-6).all()


def test_volume_to_all_three(run_tool, tmp_path, volume):
    outs = [tmp_path / f"v.{suffix}" for suffix in ("png", "html", "glb")]
    options = [part for out in outs for part in ("-o", out)]
    done = run_tool("visualize_volume", volume, *options)
    assert done.exit_code == 0, done.stderr
    assert all(out.stat().st_size > 10_000 for out in outs)
    np.testing.assert_allclose(
        trimesh.load(outs[2]).bounds, [GRID.lower / 1e3, GRID.upper / 1e3], atol=2e-4
    )


@pytest.fixture
def two_rigs(tmp_path):
    how = {"image_size": (60, 80), "footprint": 0.5, "pitch_degrees": 6.0}
    rig = rigs.ring(4, distance=400.0, volume=rigs.Volume((10, 20, 10), 1.0), **how)
    moved = replace(rig[2], t=rig[2].t + np.array([2.0, 0.0, 0.0]))
    other = replace(rig, cameras=(*rig.cameras[:2], moved, rig[3]), volume=None)
    rigs.save_rig(rig, tmp_path / "one.yaml")
    rigs.save_rig(other.transformed(np.eye(3), [50.0, 0.0, 0.0]), tmp_path / "two.yaml")
    return tmp_path / "one.yaml", tmp_path / "two.yaml"


def test_two_rigs_are_drawn_and_their_differences_printed(run_tool, tmp_path, two_rigs):
    one, two = two_rigs
    outs = [tmp_path / f"both.{suffix}" for suffix in ("png", "html", "glb")]
    options = [part for out in outs for part in ("-o", out)]
    done = run_tool("visualize_rig", one, "--compare", two, *options, "--json")
    assert done.exit_code == 0, done.stderr
    result = json.loads(done.stdout)["difference"]
    cameras = result["cameras"]
    assert max(cameras, key=lambda name: cameras[name]["distance"]) == "cam02"
    assert max(cameras, key=lambda name: cameras[name]["ray_miss"]) == "cam02"
    assert cameras["cam00"]["lens"] == pytest.approx(0, abs=1e-6)
    assert result["shift"] == pytest.approx(50, abs=1)
    assert 0.1 < result["ray_miss"] < 2
    assert result["scale"] == pytest.approx(1, abs=0.01)
    page = outs[1].read_text(encoding="utf-8")
    for words in ("other cameras", "moved", "two against one", "ray-miss (mm)", "map: views"):
        assert words in page
    assert "other cameras/cam02" in trimesh.load(outs[2]).geometry
    assert "ray-miss between both rigs" in done.stderr
    given = ("--compare", two, "--no-align", "-o", outs[2], "--json")
    as_they_stand = run_tool("visualize_rig", one, *given)
    shifts = json.loads(as_they_stand.stdout)["difference"]["cameras"]
    assert shifts["cam00"]["distance"] == pytest.approx(50)


def test_pictures_and_targets_are_layers_of_the_page(run_tool, tmp_path, two_rigs):
    one, _ = two_rigs
    rig = rigs.load_rig(one)
    corners = [[-5, -5, 0], [5, -5, 0], [5, 5, 1], [-5, 5, 1]]
    summary = {"target_poses": [{"frame": "frame07", "camera": "cam01", "corners": corners}]}
    rigs.save_rig(replace(rig, calibration=summary), one)
    for name in rig.names[:3]:
        (tmp_path / "seen" / name).mkdir(parents=True)
        picture = np.tile(np.arange(60, dtype=np.uint8) * 4, (80, 1))
        cv2.imwrite(str(tmp_path / "seen" / name / "000.png"), picture)
    out = tmp_path / "page.html"
    done = run_tool("visualize_rig", one, "--images", tmp_path / "seen", "-o", out)
    assert done.exit_code == 0, done.stderr
    page = out.read_text(encoding="utf-8")
    written = re.findall(r'"application/json"[^>]*>(.*?)</script>', page, re.DOTALL)
    data, views = (json.loads(one) for one in written)
    layers = {layer["name"] for layer in data["layers"]}
    assert {"images", "targets", "target names", "clicked rays"} <= layers
    pictured = {view["name"]: view["image"] is not None for view in views["views"]}
    assert pictured == {"cam00": True, "cam01": True, "cam02": True, "cam03": False}
    assert "frame07" in [one["text"] for one in data["labels"] if one["layer"] == "target names"]


GRID_TOO = ("--spacing", "1,2,1.5")


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("visualize_rig", "paper11_33deg", "-o", "a.eps"), "expected one of .png"),
        (("visualize_rig", "no_such_rig", "-o", "a.png"), "no_such_rig"),
        (("visualize_rig", "paper11_33deg", "--grid", "3x4", "-o", "a.png"), "--grid"),
        (("visualize_rig", "paper11_33deg", "--frame", "1", "-o", "a.png"), "--frame: expected"),
        (("visualize_rig", "posed.yaml", "-o", "a.html"), "calibration.target_poses[0]: found"),
        (("visualize_volume", "array.npy"), "array.npy: spacing: missing in a .npy, expected a"),
        (("visualize_volume", "volume.npz", *GRID_TOO), "volume.npz: spacing: found"),
        (("visualize_volume", "out.zarr", *GRID_TOO), "out.zarr: found --level"),
        (("visualize_volume", "out.zarr", "--level", "0.4"), "out.zarr: found --level"),
        (("--volume", "none.npz"), "none.npz"),
        (("--volume", "array.npy"), "array.npy: spacing: missing"),
        (("--volume", "volume.npz", *GRID_TOO), "a grid of its own"),
        (("--volume", "metres.npz"), "length_unit: found 'm'"),
        (("--compare", "nowhere.yaml"), "nowhere.yaml: no such rig file"),
        (("--images", "nowhere"), "nowhere: no such folder"),
    ],
)
def test_bad_input_is_one_line(refused, tmp_path, volume, monkeypatch, arguments, words):
    monkeypatch.chdir(tmp_path)
    np.save("array.npy", np.load(volume)["data"])
    write_volume("metres.npz", np.ones(GRID.shape, np.float32), GRID, "m")
    posed = replace(rigs.preset("paper11_33deg"), calibration={"target_poses": [{"frame": "a"}]})
    rigs.save_rig(posed, "posed.yaml")
    rig = () if arguments[0].startswith("visualize") else ("visualize_rig", "paper11_33deg")
    out = () if "-o" in arguments else ("-o", "none.glb")
    assert words in refused(*rig, *arguments, *out)
