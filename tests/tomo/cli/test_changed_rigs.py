"""Rigs that convert-rig changes fit images that were cropped, turned, binned and renamed."""

import json
from dataclasses import replace

import numpy as np
import pytest
import yaml

from rigs import Camera, Distortion, RayTable, Rig, Volume, load_rig, look_at, preset, save_rig
from rigs.recordings import write_image
from tomo import load_scan
from tomo.io import read_volume

pytestmark = pytest.mark.usefixtures("quick_choices")

GRID = ("--grid", "10x12x10", "--spacing", "2")
LENS = Distortion("brown", (-0.3, 0.1, 0.01, -0.02, 0.0))
METHOD = ("--method", "sirt", "--iterations", "15", "--no-pictures", "--no-skip")
METHOD += ("--uncertainty", "0", "--no-screen", "--no-fit-gain", "--no-fit-absorption")
METHOD += ("--refine-cameras", "none")


@pytest.fixture(scope="module")
def scene(tmp_path_factory, run_tool):
    """Return the folder of a scan by five cameras with strong lenses, and its images by camera."""
    folder = tmp_path_factory.mktemp("scene")
    cameras = []
    for number in range(5):
        angle = 0.6 * number
        place = [120 * np.sin(angle), 8.0 * number - 16, 120 * np.cos(angle)]
        R, t = look_at(place, [0, 0, 0])
        K = [[80, 0, 19], [0, 82, 25], [0, 0, 1]]
        cameras.append(Camera(f"cam{number}", (40, 48), K, LENS, R, t))
    save_rig(Rig(tuple(cameras), volume=Volume((10, 12, 10), 2.0)), folder / "rig.yaml")
    arguments = ("--rig", folder / "rig.yaml", "--phantom", "jet", "-o", folder / "scan", *GRID)
    done = run_tool("simulate", *arguments)
    assert done.exit_code == 0, done.stderr
    scan = load_scan(folder / "scan")
    return folder, dict(zip(scan.rig.names, scan.images(), strict=True))


def reconstructed(run_tool, out, *arguments):
    done = run_tool("reconstruct", *arguments, "-o", out, *GRID, *METHOD, "--json")
    assert done.exit_code == 0, done.stderr
    return read_volume(out / "volume.npz", allow_nan=True)[0], json.loads(done.stdout)


def converted(run_tool, source, target, *options):
    done = run_tool("convert_rig", source, target, *options, "--json")
    assert done.exit_code == 0, done.stderr
    return load_rig(target), json.loads(done.stdout)["notes"]


def write_images(folder, images):
    for name, image in images.items():
        (folder / name).mkdir(parents=True)
        write_image(folder / name / "t0.tif", np.ascontiguousarray(image))


def binned(image):
    rows, columns = image.shape
    return image.reshape(rows // 2, 2, columns // 2, 2).mean(axis=(1, 3), dtype=np.float64)


def test_turned_and_renamed_images_give_the_same_volume(scene, run_tool, tmp_path):
    folder, images = scene
    expected, report = reconstructed(run_tool, tmp_path / "plain", folder / "scan")
    options = ("--rotate", "90", "--rotate", "cam2=180", "--rotate", "cam3=270")
    options += ("--rename", "cam1=cam4", "--rename", "cam4=cam1")
    rig, notes = converted(run_tool, folder / "rig.yaml", tmp_path / "turned.yaml", *options)
    assert notes == []
    assert rig.names == ("cam0", "cam4", "cam2", "cam3", "cam1")
    quarters = {"cam2": 2, "cam3": 3}
    renamed = {"cam1": "cam4", "cam4": "cam1"}
    changed = {
        renamed.get(name, name): np.rot90(image, -quarters.get(name, 1))
        for name, image in images.items()
    }
    write_images(tmp_path / "images", changed)
    taken = ("--images", tmp_path / "images", "--rig")
    found, turned = reconstructed(run_tool, tmp_path / "out", *taken, tmp_path / "turned.yaml")
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-5 * expected.max())
    fits = [one["relative_residual"] for one in (report, turned)]
    assert fits[1] == pytest.approx(fits[0], rel=1e-3)
    # and without the turn of the rig nothing fits
    wrong, _ = converted(run_tool, folder / "rig.yaml", tmp_path / "wrong.yaml", "--rotate", "270",
                         "--rotate", "cam2=0", "--rotate", "cam3=90", *options[-4:])  # fmt: skip
    assert wrong[0].image_size == rig[0].image_size
    _, misfit = reconstructed(run_tool, tmp_path / "not", *taken, tmp_path / "wrong.yaml")
    assert misfit["relative_residual"] > 3 * fits[0]


def test_binned_images_give_what_reconstruct_gives_by_scale(scene, run_tool, tmp_path):
    folder, images = scene
    expected, _ = reconstructed(run_tool, tmp_path / "plain", folder / "scan", "--scale", "2")
    converted(run_tool, folder / "rig.yaml", tmp_path / "binned.yaml", "--scale", "2")
    write_images(tmp_path / "images", {name: binned(image) for name, image in images.items()})
    given = ("--rig", tmp_path / "binned.yaml", "--images", tmp_path / "images")
    found, _ = reconstructed(run_tool, tmp_path / "out", *given)
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-5 * expected.max())


def test_cropped_images_give_what_whole_ones_give(scene, run_tool, tmp_path):
    folder, images = scene
    options = ("--scale", "2", "--drop", "cam4")
    whole, _ = converted(run_tool, folder / "rig.yaml", tmp_path / "whole.yaml", *options)
    options += ("--crop", "4,4,34,44", "--crop", "cam0=2,2,36,42", "--rotate", "cam0=90")
    rig, _ = converted(run_tool, folder / "rig.yaml", tmp_path / "cropped.yaml", *options)
    assert [camera.image_size for camera in rig] == [(21, 18)] + [(17, 22)] * 3
    changed = {name: binned(images[name][4:48, 4:38]) for name in rig.names[1:]}
    changed["cam0"] = binned(np.rot90(images["cam0"][2:44, 2:38], -1))
    kept = [changed[name].sum() / binned(images[name]).sum() for name in rig.names]
    assert min(kept) > 0.999  # the jet is in the windows
    write_images(tmp_path / "w", {name: binned(images[name]) for name in whole.names})
    write_images(tmp_path / "c", changed)
    volumes = [
        reconstructed(run_tool, tmp_path / out, "--rig", tmp_path / rig, "--images", tmp_path / at)
        for out, rig, at in (("a", "whole.yaml", "w"), ("b", "cropped.yaml", "c"))
    ]
    (expected, _), (found, _) = volumes
    assert np.linalg.norm(found - expected) < 0.05 * np.linalg.norm(expected)


def test_a_world_file_moves_cameras_and_says_what_it_leaves_out(scene, run_tool, tmp_path):
    folder, _ = scene
    tilt = [[0.8, -0.6, 0], [0.6, 0.8, 0], [0, 0, 1]]
    path = tmp_path / "world.yaml"
    path.write_text(yaml.safe_dump({"R": tilt, "t": [1, 2, 3]}))
    rig, notes = converted(run_tool, folder / "rig.yaml", tmp_path / "a.yaml", "--world", path)
    assert rig.volume is None
    assert len(notes) == 1
    assert notes[0].startswith("volume: left out")
    points = np.random.default_rng(0).uniform(-10, 10, (50, 3))
    for before, after in zip(load_rig(folder / "rig.yaml"), rig, strict=True):
        moved = points @ np.transpose(tilt) + [1, 2, 3]
        expected = before.project(points)[0]
        np.testing.assert_allclose(after.project(moved)[0], expected, rtol=0, atol=1e-9)


def test_shrinking_says_where_pixels_are_left_over(scene, run_tool, tmp_path):
    folder, _ = scene
    options = ("--scale", "cam1=3", "--keep", "cam1,cam2")
    _, (note,) = converted(run_tool, folder / "rig.yaml", tmp_path / "a.yaml", *options)
    assert note.startswith("--scale: sides of cam1 (40 x 48) are no multiples of it")


def test_a_table_of_rays_is_changed_and_written(run_tool, tmp_path):
    lens = Distortion("brown", (-0.2, 0.05, 0.01, -0.02))
    camera = Camera("a", (64, 48), [[80, 0, 32], [0, 80, 24], [0, 0, 1]], lens, t=[0, 0, 100.0])
    save_rig(Rig((RayTable.of(camera), replace(camera, name="b"))), tmp_path / "rig.yaml")
    options = ("--crop", "2,1,60,40", "--rotate", "90", "--scale", "2", "--rename", "a=c")
    options += ("--length-unit", "cm")
    rig, _ = converted(run_tool, tmp_path / "rig.yaml", tmp_path / "out.yaml", *options)
    assert rig.names == ("c", "b")
    assert rig["c"].image_size == rig["b"].image_size == (20, 30)
    for found, expected in zip(rig["c"].rays(), rig["b"].rays(), strict=True):
        np.testing.assert_allclose(found, expected, rtol=0, atol=2e-4)  # between pixels
    given = load_rig(tmp_path / "rig.yaml")["a"]
    again = given.cropped(2, 1, 60, 40).rotated(90).shrunk(2)
    np.testing.assert_array_equal(rig["c"].rays()[1], again.rays()[1])
    np.testing.assert_allclose(rig["c"].rays()[0], again.rays()[0] / 10, rtol=0, atol=1e-12)


def test_names_with_an_equals_sign_are_found(run_tool, tmp_path):
    camera = preset("paper11_33deg")[0]
    odd = Camera("a=b", camera.image_size, camera.camera_matrix, t=camera.t)
    save_rig(Rig((odd,)), tmp_path / "rig.yaml")
    options = ("--crop", "a=b=0,0,20,30", "--rename", "a=b=c=d")
    rig, _ = converted(run_tool, tmp_path / "rig.yaml", tmp_path / "b.yaml", *options)
    assert rig["c=d"].image_size == (20, 30)


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (
            ("--drop", "cam0", "--rotate", "cam0=90"),
            "camera cam0: not in the rig, expected one of",
        ),
        (("--drop", "cam0,cam1,cam2,cam3,cam4"), "--keep and --drop: found no camera left"),
        (("--crop", "1,2,3"), "--crop: found '1,2,3', expected pixels x,y,width,height"),
        (("--crop", "cam0=30,0,20,20"), "camera cam0: crop: found x, y, width, height = (30, 0,"),
        (("--crop", "0,0,9,9", "--crop", "0,0,8,8"), "--crop: found twice for all cameras"),
        (("--rotate", "cam0=90", "--rotate", "cam0=90"), "--rotate: found twice for camera cam0"),
        (("--rotate", "45"), "--rotate: found '45', expected 90, 180 or 270, clockwise"),
        (("--scale", "nan"), "--scale: found 'nan', expected a number above 0"),
        (("--scale", "100"), "camera cam0: scale: found 0.01, which leaves nothing of 40 x 48"),
        (("--rename", "cam0"), "--rename: found 'cam0', expected A=B"),
        (("--rename", "cam0=cam1"), "there is a camera cam1: choose another name"),
        (("--rename", "cam0=a", "--rename", "cam0=b"), "--rename: found camera cam0 twice"),
        (("--world", "none.yaml"), "none.yaml: no such file"),
    ],
)
def test_bad_changes_are_one_line(scene, refused, tmp_path, options, words):
    assert words in refused("convert_rig", scene[0] / "rig.yaml", tmp_path / "x.yaml", *options)
