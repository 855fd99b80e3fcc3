"""``flametomo init``: a bare folder becomes a scan that reconstructs as a handwritten one does."""

import json
import shutil
from types import SimpleNamespace

import numpy as np
import pytest
import yaml

import rigs
from phantoms import GaussianBlobs
from rigs.recordings import write_image
from tomo import Options, VoxelGrid, load_scan, reconstruct
from tomo.cli import init as command
from tomo.simulation import simulate_images

GRID = VoxelGrid((12, 16, 12), 0.8, (2, -1, 0))
QUICK = Options(
    method="cgls", iterations=8, uncertainty=0,
    screen=False, refine_cameras="none", fit_gain=False, fit_absorption=False,
)  # fmt: skip
DRAWN = ("--grid", "12x16x12", "--spacing", "0.8", "--center", "2,-1,0")


@pytest.fixture(scope="module")
def original(tmp_path_factory):
    """Return a handwritten scan of a flame, and its truth."""
    folder = tmp_path_factory.mktemp("original") / "scan"
    field = GaussianBlobs([[1.6, -2.0, 0.3], [2.5, 0.6, -0.5]], [1.0, 0.9], [1.0, 0.8])
    ring = rigs.ring(5, distance=150.0, image_size=(48, 56), footprint=0.45, pitch_degrees=8.0)
    rig = rigs.Rig(tuple(ring.transformed(np.eye(3), GRID.center)), "mm")
    made = simulate_images(rig, field, GRID, supersample=2, refine=2, noise=0.005, seed=3)
    made.save(folder)
    return SimpleNamespace(folder=folder, rig=rig, field=field, truth=made.truth)


@pytest.fixture
def bare(original, tmp_path):
    """Return a folder with camera folders of the images, and a calibration; nothing else."""
    folder = tmp_path / "run 7"
    shutil.copytree(original.folder / "images", folder)
    rigs.formats.save(original.rig, folder / "calibration.yml", "opencv")
    return folder


def test_the_volume_is_that_of_the_handwritten_scan(run_tool, original, bare):
    done = run_tool("init", bare, *DRAWN)
    assert done.exit_code == 0, done.stderr
    assert {path.name for path in bare.iterdir() if path.is_file()} == {
        "calibration.yml", "rig.yaml", "scan.yaml", "thumbnails.png"
    }  # fmt: skip
    hand, found = (load_scan(folder) for folder in (original.folder, bare))
    assert found.grid == hand.grid
    for one, other in zip(hand.images(), found.images(), strict=True):
        np.testing.assert_array_equal(one, other)
    volumes = [reconstruct(scan, options=QUICK).volume for scan in (hand, found)]
    np.testing.assert_allclose(*volumes, atol=1e-5 * volumes[0].max())


def test_the_proposed_box_gives_as_good_a_volume(run_tool, original, bare):
    done = run_tool("init", bare, "--spacing", "0.8", "--json")
    assert done.exit_code == 0, done.stderr
    said = json.loads(done.stdout)
    assert said["cameras"] == list(original.rig.names)
    assert said["images"] == "{camera}/{frame}.tif"
    assert said["next"][0] == f"flametomo check-rig '{bare}'"
    found = load_scan(bare)
    errors = []
    for scan in (load_scan(original.folder), found):
        fine = scan.grid.refined(2)
        truth = scan.grid.average(
            original.field(fine.centers().reshape(-1, 3)).reshape(fine.shape), 2
        )
        volume = reconstruct(scan, options=QUICK).volume
        errors.append(np.sqrt(np.sum((volume - truth) ** 2)))
    assert errors[1] < 1.1 * errors[0]


def test_what_is_found_and_assumed_is_said_and_stands_in_the_files(run_tool, original, bare):
    for camera in original.rig.names:
        write_image(bare / camera / "dark" / "1.tif", np.zeros((56, 48), np.float32))
        (bare / camera).rename(bare / camera.replace("cam0", "Camera_"))
    done = run_tool("init", bare)
    assert done.exit_code == 0, done.stderr
    lines = done.stderr.splitlines()
    text = (bare / "scan.yaml").read_text("utf-8")
    comments = " ".join(" ".join(line.strip(" #").split()) for line in text.splitlines())
    for about in ("rig: 5 cameras from calibration.yml (opencv), found",
                  "  assumed: names of cameras that differ in writing alone mean the same: ",
                  "images: images of 5 cameras named {camera}/{frame}.tif, 1 frame",
                  "dark: {camera}/dark, found by its name",
                  "grid: box around the light of frame frame_000 in 5 views",
                  "  voxels of "):  # fmt: skip
        (line,) = [one for one in lines if one.startswith(about)]
        assert line.split(": ", 1)[-1][:50].strip() in comments
    assert lines[-2].startswith("next: flametomo check-rig ")
    assert lines[-1].startswith("next: flametomo reconstruct ")
    content = yaml.safe_load(text)
    assert content["corrections"] == {"dark": "{camera}/dark"}


def test_files_that_are_there_are_kept_without_force(run_tool, refused, bare):
    (bare / "scan.yaml").write_text("mine", "utf-8")
    words = f"{bare / 'scan.yaml'}: found a file, expected none; --force overwrites it"
    assert words in refused("init", bare)
    assert run_tool("init", bare, "--force").exit_code == 0
    before = (bare / "rig.yaml").read_bytes()
    assert load_scan(bare).grid
    again = run_tool("init", bare, "--force", "--spacing", "1.5")
    assert again.exit_code == 0, again.stderr
    assert (bare / "rig.yaml").read_bytes() == before  # it is the rig now
    assert load_scan(bare).grid.spacing == (1.5, 1.5, 1.5)


def dark(*names, shape=(56, 48)):
    def write(folder):
        for name in names:
            write_image(folder / "dark" / f"{name}.tif", np.zeros(shape, np.float32))

    return write


def image(name, shape=(9, 8)):
    return lambda folder: write_image(folder / "cam02" / name, np.zeros(shape, np.float32))


def two_rigs(folder):
    rigs.save_rig(rigs.load(folder / "calibration.yml"), folder / "other.yaml")


def no_images(folder):
    for path in folder.glob("*/*.tif"):
        path.unlink()


def other_names(folder):
    for number, path in enumerate(sorted(folder.glob("cam*"))):
        path.rename(folder / f"view{'abcde'[number]}")


def moved_in_time(folder):
    (folder / "cam02" / "frame_000.tif").rename(folder / "cam02" / "frame_007.tif")


CAMERAS = [f"cam0{number}" for number in range(5)]


@pytest.mark.parametrize(
    ("damage", "said"),
    [
        (lambda f: (f / "calibration.yml").unlink(), "run 7: rig: found none, expected"),
        (two_rigs, "rigs: found calibration.yml and other.yaml, expected one: --rig calib"),
        (no_images, "run 7: images: found none, expected files that end in .tif"),
        (lambda f: shutil.rmtree(f / "cam03"), "camera cam03: found no image named"),
        (lambda f: shutil.copytree(f / "cam03", f / "extra"), "camera extra: found no such"),
        (image("frame_001.tif"), "frame_001.tif: camera cam02: found 8 x 9 pixels, expected 48 x"),
        (image("frame_000.tif"), "frame_000.tif: camera cam02: found 8 x 9 pixels, expected 48 x"),
        (other_names, "none named as a camera of the rig, cam00, cam01, cam02, cam03, cam04"),
        (moved_in_time, "found no image, and no frame with one of each camera"),
        (dark("cam00", "cam01"), "camera cam02: dark: found no frame named dark"),
        (dark("0", "1"), "dark: found 2 frames, the first dark/0.tif, none named as a camera"),
        (dark(*CAMERAS, shape=(9, 8)), "camera cam00: dark: found 8 x 9 pixels, expected 48 x 56"),
    ],
)
def test_a_folder_that_says_too_little_is_refused(refused, bare, damage, said):
    damage(bare)
    assert said in refused("init", bare)


@pytest.mark.parametrize(
    ("options", "said"),
    [
        (("--rig", "nowhere.yaml"), "nowhere.yaml: no such rig file"),
        (("--pattern", "{frame}.tif"), "pattern: found '{frame}.tif', expected"),
        (("--pattern", "{camera}.tif"), "pattern: found no image named '{cam"),
        (("--dark", "nowhere"), "--dark: found 'nowhere', expected a folder"),
        (("--dark", ".."), "--dark: found .., expected a folder or file inside"),
        (("--drop", "cam9"), "camera cam9: not in the rig, expected one of cam00"),
        (("--rename", "cam00"), "--rename: found 'cam00', expected CAMERA=NAME"),
        (("--grid", "9x9x9"), "--grid and --spacing: expected both"),
        (("--lower", "1,2,3"), "--lower and --upper: found one of them, expected"),
        (("--spacing", "1,2,3"), "--spacing: found 1,2,3, expected one length"),
    ],
)
def test_bad_options_are_one_line(refused, bare, options, said):
    assert said in refused("init", bare, *options)


def test_drop_and_rename_make_folder_and_rig_agree(run_tool, bare):
    shutil.rmtree(bare / "cam03")
    (bare / "cam04").rename(bare / "top")
    done = run_tool("init", bare, "--drop", "cam03", "--rename", "cam04=top")
    assert done.exit_code == 0, done.stderr
    assert load_scan(bare).rig.names == ("cam00", "cam01", "cam02", "top")


@pytest.mark.parametrize("options", [(), ("--spacing", "0.8")])
def test_a_terminal_is_asked_only_without_options(run_tool, bare, monkeypatch, options):
    two_rigs(bare)
    terminal = SimpleNamespace(isatty=lambda: True)
    monkeypatch.setattr(command, "sys", SimpleNamespace(stdin=terminal, stderr=terminal))
    answers = iter((7, 2))
    monkeypatch.setattr(command.typer, "prompt", lambda *_, **__: next(answers))
    done = run_tool("init", bare, *options)
    assert done.exit_code == (2 if options else 0)
    if not options:
        assert "  1  calibration.yml" in done.stderr.splitlines()
        assert "5 cameras from other.yaml (emission_rig), named" in done.stderr


REAL = {
    "plume_series": ((), 5, 40),
    "scalarflow": (("--length-unit", "m"), 5, 2),
    "dino_sparse_ring": (("--channel", "r", "--rig", "dinoSR_par.txt"), 16, 1),
}


@pytest.mark.parametrize("name", REAL)
def test_real_sets_become_scans(run_tool, test_data, tmp_path, name):
    options, cameras, frames = REAL[name]
    folder = tmp_path / name
    shutil.copytree(test_data / name, folder)
    done = run_tool("init", folder, *options)
    assert done.exit_code == 0, done.stderr
    scan = load_scan(folder)
    assert len(scan.rig) == cameras
    assert len(scan.frames) == frames
    assert scan.rig.length_unit == "m"
    if cameras == 5:  # a plume before black: nearly all light is on lines through the box
        scan = scan.scaled(max(1, scan.rig[0].image_size[0] // 90))
        for image, camera in zip(scan.images(scan.frame_names[-1]), scan.rig, strict=True):
            origins, directions = camera.rays()
            ends = [(edge - origins) / directions for edge in (scan.grid.lower, scan.grid.upper)]
            enters, leaves = np.minimum(*ends).max(axis=1), np.maximum(*ends).min(axis=1)
            assert image.ravel()[enters < leaves].sum() > 0.99 * image.sum()
        assert (scan.grid.extent < 1.2).all()
