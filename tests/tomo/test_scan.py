import copy
import errno
import os
import shutil
from pathlib import Path

import numpy as np
import pytest
import yaml
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from rigs import Camera, Rig, save_rig
from rigs.camera import look_at
from tomo import Rays, Scan, VoxelGrid
from tomo.io import read_volume, write_image
from tomo.scan import Corrections, Frame
from tomo.scan_file import save_scan

SIZES = {"left": (7, 5), "right": (9, 8)}  # (width, height)
GRID = VoxelGrid((2, 3, 4), 0.5, (0.0, 1.0, 2.0))


def camera(name, position):
    R, t = look_at(position, (0, 0, 0))
    width, height = SIZES[name]
    K = np.array([[50.0, 0, (width - 1) / 2], [0, 50, (height - 1) / 2], [0, 0, 1]])
    return Camera(name, SIZES[name], K, R=R, t=t)


RIG = Rig((camera("left", (100.0, 0, 0)), camera("right", (0, 10.0, 100.0))))


def random_images(seed):
    random = np.random.default_rng(seed)
    return {n: random.random((h, w)).astype(np.float32) for n, (w, h) in SIZES.items()}


FRAMES = {"first": random_images(0), "second": random_images(1)}


@pytest.fixture
def folder(tmp_path):
    """Return a scan folder that the test may spoil."""
    save_scan(tmp_path / "scan", RIG, FRAMES, grid=GRID, truth=np.ones(GRID.shape))
    return tmp_path / "scan"


def edit(folder, change):
    """Change the content of a scan.yaml by a function."""
    path = folder / "scan.yaml"
    content = yaml.safe_load(path.read_text())
    change(content)
    path.write_text(yaml.safe_dump(content))
    return path


def assert_refused(action, *parts, error=ValueError):
    """Assert a one-line error that holds all parts."""
    with pytest.raises(error) as caught:
        action()
    message = str(caught.value)
    assert "\n" not in message
    for part in parts:
        assert part in message, message


def test_round_trip(folder):
    for path in (folder, folder / "scan.yaml", str(folder)):
        scan = Scan.load(path)
        assert scan.rig == RIG
        assert scan.grid == GRID
        assert scan.frame_names == ("first", "second")
        for name, images in FRAMES.items():
            for found, expected in zip(scan.images(name), images.values(), strict=True):
                assert found.dtype == np.float32
                np.testing.assert_array_equal(found, expected)
            assert all(mask.dtype == bool and mask.all() for mask in scan.masks(name))
    assert read_volume(scan.truth)[1] == GRID
    assert scan.effects is None


def test_what_a_scan_was_simulated_with_comes_back(tmp_path):
    camera = RIG.names[0]
    effects = {"absorption": 0.5, "focus_distance": None, "gains": {camera: 1.25}}
    save_scan(tmp_path, RIG, FRAMES, effects=effects)
    found = Scan.load(tmp_path).effects
    assert found["absorption"] == 0.5
    assert found["vignetting"] == 0
    assert found["focus_distance"] is None
    assert found["gains"] == {camera: 1.25}


def test_no_frame_named_is_the_first(folder):
    scan = Scan.load(folder)
    np.testing.assert_array_equal(scan.images()[0], FRAMES["first"]["left"])


def test_the_grid_is_the_rigs_volume_where_the_scan_names_none(folder):
    edit(folder, lambda content: content.pop("grid"))
    assert Scan.load(folder).grid is None


def test_an_interrupted_run_leaves_the_scan_that_was_there(tmp_path, monkeypatch):
    save_scan(tmp_path, RIG, FRAMES)
    before = {path: path.read_bytes() for path in tmp_path.rglob("*") if path.is_file()}
    brighter = {
        frame: {camera: 2 * image for camera, image in images.items()}
        for frame, images in FRAMES.items()
    }
    calls = []

    def full_disk(path, image):
        calls.append(path)
        if len(calls) == 2:
            raise OSError(errno.ENOSPC, "No space left on device", str(path))
        write_image(path, image)

    monkeypatch.setattr("tomo.scan_file.write_image", full_disk)
    with pytest.raises(OSError, match="No space left") as caught:
        save_scan(tmp_path, RIG, brighter)
    assert Path(caught.value.filename).parents[2] == tmp_path  # as the user knows it
    assert {path: path.read_bytes() for path in tmp_path.rglob("*") if path.is_file()} == before
    assert Scan.load(tmp_path)


# --- corrections


def test_corrections_follow_the_formula(folder):
    random = np.random.default_rng(5)
    dark = random.random((5, 7)).astype(np.float32) * 0.1
    flat = 0.5 + random.random((5, 7)).astype(np.float32)
    write_image(folder / "dark.tif", dark)
    write_image(folder / "flat.tif", flat)
    corrections = {
        "dark": {"left": "dark.tif", "right": 0.25},
        "flat": {"left": "flat.tif"},
        "gain": {"right": 3.0},
    }
    edit(folder, lambda content: content.update(corrections=corrections))
    left, right = Scan.load(folder).images("first")
    raw = FRAMES["first"]
    np.testing.assert_allclose(left, (raw["left"] - dark) / flat, rtol=1e-5, atol=1e-7)
    np.testing.assert_allclose(right, (raw["right"] - 0.25) * 3, rtol=1e-5, atol=1e-6)


def test_masks_come_from_mask_saturation_and_dead_flat(folder):
    mask = np.full((5, 7), 255, np.uint8)
    mask[0, 0] = 0
    flat = np.ones((5, 7), np.float32)
    flat[1, 1] = 0
    write_image(folder / "mask.png", mask)
    write_image(folder / "flat.tif", flat)
    raw = np.full((5, 7), 0.5, np.float32)
    raw[0, 0], raw[2, 3] = np.nan, 1.0
    write_image(folder / "images/left/first.tif", raw)
    corrections = {
        "mask": {"left": "mask.png"},
        "flat": {"left": "flat.tif"},
        "saturation": 0.99,
        "bit_depth": 12,
    }
    edit(folder, lambda content: content.update(corrections=corrections))
    scan = Scan.load(folder).only("left")
    (image,), (usable,) = scan.read("first")
    assert np.argwhere(~usable).tolist() == [[0, 0], [1, 1], [2, 3]]
    assert np.isfinite(image).all()
    np.testing.assert_array_equal(image[usable], 0.5)
    np.testing.assert_array_equal(image[~usable], 0)


@pytest.mark.parametrize("name", ["saturation", "dark"])
def test_counts_of_a_camera_are_no_correction_of_integers(folder, name):
    """Integers are read as shares of full scale: no pixel would be saturated, or none dark."""
    edit(folder, lambda content: content.update(corrections={name: {"left": 400}}))
    Scan.load(folder).images("first")
    write_image(folder / "images/left/first.tif", np.full((5, 7), 4095, np.uint16))
    assert_refused(
        Scan.load(folder).images,
        f"scan.yaml: corrections.{name}: camera left: found 400",
        "expected at most 1, the full scale of integers like those in",
        "first.tif",
    )


def test_bit_depth_reaches_the_images(folder):
    write_image(folder / "images/left/first.tif", np.full((5, 7), 4095, np.uint16))
    edit(folder, lambda content: content.update(corrections={"bit_depth": {"left": 12}}))
    np.testing.assert_array_equal(Scan.load(folder).images()[0], 1)


# --- views of a scan


@pytest.mark.parametrize("factor", [1, 2, 3, 4])
def test_area_means_keep_the_mean_and_what_each_pixel_sees(folder, factor):
    scan = Scan.load(folder)
    small = scan.scaled(factor)
    for big, image, shrunk in zip(RIG, small.images(), small.rig, strict=True):
        width, height = (side - side % factor for side in big.image_size)
        assert shrunk.image_size == (width // factor, height // factor)
        assert image.shape == shrunk.image_size[::-1]
        whole = FRAMES["first"][big.name][:height, :width]
        assert image.mean() == pytest.approx(whole.mean(), rel=1e-6)
        # pixel (column 1, row 0) of the small image is the block of the big one beside the first
        centre = [[factor + (factor - 1) / 2, (factor - 1) / 2]]
        np.testing.assert_allclose(shrunk.rays([[1, 0]])[1], big.rays(centre)[1], atol=1e-12)


def test_shrinking_twice_is_shrinking_by_the_product(folder):
    scan = Scan.load(folder).only("right")
    twice, once = scan.scaled(2).scaled(2), scan.scaled(4)
    assert twice.rig["right"].image_size == once.rig["right"].image_size
    np.testing.assert_allclose(twice.images()[0], once.images()[0], rtol=1e-6)


def test_rays_of_a_shrunk_scan_are_the_scans_own(folder):
    small = Scan.load(folder).scaled(2)
    assert Rays.from_camera(small.rig["left"]).n_pixels == small.images()[0].size


def test_a_shrunk_pixel_is_usable_only_when_all_of_it_is(folder):
    mask = np.ones((5, 7), np.uint8)
    mask[3, 2] = 0
    write_image(folder / "mask.png", mask)
    edit(folder, lambda content: content.update(corrections={"mask": {"left": "mask.png"}}))
    images, masks = Scan.load(folder).scaled(2).read()
    assert np.argwhere(~masks[0]).tolist() == [[1, 1]]
    assert masks[1].all()
    assert np.isfinite(images[0]).all()


def test_holding_cameras_out(folder):
    scan = Scan.load(folder)
    assert scan.without("left").rig.names == ("right",)
    assert scan.only("right").rig.names == ("right",)
    assert scan.only("right", "left").rig.names == ("left", "right")
    np.testing.assert_array_equal(scan.without("left").images()[0], FRAMES["first"]["right"])


# --- other sources


def test_a_rig_and_a_folder_of_images(folder, tmp_path):
    rig_file = tmp_path / "rig.yaml"
    save_rig(RIG, rig_file)
    for rig in (RIG, rig_file):
        scan = Scan.from_images(rig, folder / "images")
        assert scan.frame_names == ("first", "second")
        np.testing.assert_array_equal(scan.images("second")[1], FRAMES["second"]["right"])
    write_image(folder / "images/left/first.png", np.zeros((5, 7), np.uint8))
    assert_refused(
        lambda: Scan.from_images(RIG, folder / "images"), "camera left", "'first' twice"
    )
    shutil.rmtree(folder / "images/left")
    assert_refused(
        lambda: Scan.from_images(RIG, folder / "images"),
        "camera left",
        "no folder left",
        error=FileNotFoundError,
    )


def test_the_real_plume(test_data):
    scan = Scan.load(test_data / "scalarflow" / "transforms.json")
    assert "frame_090" in scan.frame_names
    small = scan.without("cam02").scaled(6)
    images = small.images("frame_090")
    assert len(images) == 4
    assert all(image.shape == (320, 180) and 0 < image.max() <= 1 for image in images)


# --- bad input


def test_unknown_names_list_the_known_ones(folder):
    scan = Scan.load(folder)
    assert_refused(lambda: scan.images("third"), "scan.yaml", "'third'", "first, second")
    assert_refused(lambda: scan.without("cam9"), "scan.yaml", "'cam9'", "left, right")
    assert_refused(lambda: scan.only("cam9"), "'cam9'", "left, right")
    assert_refused(lambda: scan.without("left", "right"), "cameras", "none")


@pytest.mark.parametrize("factor", [0, 1.5, -2, 6])
def test_bad_scales(folder, factor):
    assert_refused(lambda: Scan.load(folder).scaled(factor), "scale", f"found {factor}")


def test_missing_images_and_cameras(folder):
    (folder / "images/right/first.tif").unlink()
    assert_refused(
        lambda: Scan.load(folder).images(),
        "camera right",
        "first.tif: no such image",
        error=FileNotFoundError,
    )
    edit(folder, lambda content: content["frames"][0]["images"].pop("right"))
    scan = Scan.load(folder)
    assert_refused(scan.images, "scan.yaml", "frame 'first'", "camera right", "no image")
    np.testing.assert_array_equal(scan.without("right").images()[0], FRAMES["first"]["left"])
    edit(folder, lambda content: content["frames"][0]["images"].update(cam9="images/x.tif"))
    assert_refused(lambda: Scan.load(folder), "scan.yaml", "frame 'first'", "'cam9'", "left")


def test_folders_that_fit_no_camera_are_listed(folder, tmp_path):
    images = tmp_path / "misspelt"
    shutil.copytree(folder / "images", images)
    (images / "left").rename(images / "lefft")
    assert_refused(
        lambda: Scan.from_images(RIG, images),
        "camera left: found no folder left",
        "it has lefft, right",
        error=FileNotFoundError,
    )
    (images / "lefft").rename(images / "left")
    for image in (images / "left").iterdir():
        image.rename(image.with_suffix(".raw"))
    assert_refused(
        lambda: Scan.from_images(RIG, images),
        f"{images / 'left'}: camera left",
        ".tif, .tiff, .png",
    )


def test_bad_pixels(folder):
    path = folder / "images/left/first.tif"

    def refused(image, *parts):
        write_image(path, image)
        assert_refused(Scan.load(folder).images, "camera left", "first.tif", *parts)

    refused(np.zeros((7, 5), np.float32), "5 x 7 pixels, expected 7 x 5")
    refused(np.full((5, 7), np.nan), "35 NaN", "row 0, column 0")
    import tifffile

    tifffile.imwrite(path, np.zeros((5, 7, 3), np.uint8))
    assert_refused(Scan.load(folder).images, "camera left", "first.tif", "3 channels")
    path.write_bytes(path.read_bytes()[:60])
    assert_refused(Scan.load(folder).images, "camera left", "first.tif", "not a readable image")


@pytest.mark.parametrize(
    "escape", ["/etc/passwd", "../other/first.tif", "images/../../x.tif", "C:\\x.tif", "..\\x.tif"]
)
def test_paths_that_leave_the_folder(folder, escape):
    def change_image(content):
        content["frames"][0]["images"]["left"] = escape

    def change_truth(content):
        content["truth"] = escape

    def change_dark(content):
        content["corrections"] = {"dark": {"left": escape}}

    def change_rig(content):
        content["rig"] = escape

    original = (folder / "scan.yaml").read_text()
    for change, field in [
        (change_image, "frame 'first': camera left"),
        (change_truth, "truth"),
        (change_dark, "corrections.dark: camera left"),
        (change_rig, "rig"),
    ]:
        (folder / "scan.yaml").write_text(original)
        edit(folder, change)
        assert_refused(lambda: Scan.load(folder), "scan.yaml", field, "inside the scan folder")


def test_links_that_leave_the_folder(folder, tmp_path):
    outside = tmp_path / "outside.tif"
    write_image(outside, np.zeros((5, 7)))
    link = folder / "images/left/first.tif"
    link.unlink()
    os.symlink(outside, link)
    assert_refused(lambda: Scan.load(folder), "camera left", "inside the scan folder")
    moved = tmp_path / "linked"  # the folder itself may be reached through a link
    link.unlink()
    write_image(link, np.zeros((5, 7)))
    os.symlink(folder, moved)
    assert Scan.load(moved).images()[0].shape == (5, 7)


@pytest.mark.parametrize(
    ("change", "parts"),
    [
        (lambda c: c.update(format="emission-rig"), ["format", "'emission-rig'", "emission-scan"]),
        (lambda c: c.update(version=2), ["version", "found 2", "expected 1"]),
        (lambda c: c.update(format="emission-rig", cameras=[]), ["format: found 'emission-rig'"]),
        (lambda c: c.pop("frames"), ["frames: missing, expected a list of mappings"]),
        (lambda c: c.update(frames=[]), ["frames: found none, expected at least one"]),
        (lambda c: c["frames"].append(copy.deepcopy(c["frames"][0])), ["'first'", "twice"]),
        (
            lambda c: c["frames"][0].update(name=7),
            ["frames[0]: name: found 7, expected text (put it in quotes)"],
        ),
        (
            lambda c: c["frames"][0]["images"].update(left=3),
            ["frame 'first': images.left: found 3, expected text"],
        ),
        (lambda c: c.update(colour="red"), ["colour", "unknown field"]),
        (
            lambda c: c.update(trut=c.pop("truth", "x")),
            ["trut: unknown field, did you mean truth?"],
        ),
        (lambda c: c.update(grid="3x4x5"), ["grid: found '3x4x5', expected a mapping"]),
        (
            lambda c: c["grid"].update(shape=[1, 2]),
            ["grid.shape: found 2 values, expected a list of 3 whole numbers"],
        ),
        (lambda c: c["grid"].update(spacing=-1.0), ["grid spacing", "-1.0"]),
        (lambda c: c["grid"].update(spacing=float("nan")), ["grid.spacing", "nan"]),
        (lambda c: c.update(corrections={"gain": 0}), ["corrections.gain", "found 0"]),
        (
            lambda c: c.update(corrections={"gain": {"left": "x"}}),
            ["corrections.gain", "camera left", "'x'"],
        ),
        (lambda c: c.update(corrections={"gain": {"cam9": 1}}), ["corrections.gain", "'cam9'"]),
        (lambda c: c.update(corrections={"gain": {"a\nb": "x"}}), ["corrections.gain", "a\\nb"]),
        (lambda c: c["frames"][0]["images"].update({"a\nb": "../x"}), ["frame 'first'", "a\\nb"]),
        (lambda c: c.update(corrections={"bit_depth": 17}), ["corrections.bit_depth", "17"]),
        (lambda c: c.update(corrections={"mask": True}), ["corrections.mask", "True"]),
        (lambda c: c.update(truth="a\0b"), ["truth"]),
        (lambda c: c.update(truth="x" * 5000), ["truth"]),
        (lambda c: c.update(effects={"heat": 1.0}), ["effects.heat", "unknown field"]),
        (lambda c: c.update(effects={"absorption": "k"}), ["effects.absorption", "found 'k'"]),
        (lambda c: c.update(effects={"gains": {"cam9": 1.0}}), ["effects.gains", "'cam9'"]),
    ],
)
def test_bad_fields_are_named(folder, change, parts):
    edit(folder, change)
    assert_refused(lambda: Scan.load(folder), "scan.yaml", *parts)


@pytest.mark.parametrize("content", ["", "[1, 2", "- 1", "a: &a [*a]", "x: 2001-99-99", "\0"])
def test_what_is_no_scan_file(folder, content):
    (folder / "scan.yaml").write_text(content)
    assert_refused(lambda: Scan.load(folder), "scan.yaml")


def test_nothing_there(tmp_path):
    for path in (tmp_path, tmp_path / "none", tmp_path / "none.yaml"):
        assert_refused(lambda path=path: Scan.load(path), str(path), error=FileNotFoundError)
    (tmp_path / "scan.txt").write_text("")
    assert_refused(lambda: Scan.load(tmp_path / "scan.txt"), "'.txt'")


ANYTHING = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=8),
    lambda inner: (
        st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=6), inner, max_size=3)
    ),
    max_leaves=6,
)


@settings(max_examples=80, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(st.data())
def test_a_scan_file_with_anything_in_it_loads_or_is_refused_in_one_line(folder, data):
    path = folder / "scan.yaml"
    if not (folder / "good.yaml").exists():
        shutil.copy(path, folder / "good.yaml")
    content = yaml.safe_load((folder / "good.yaml").read_text())
    content["corrections"] = {"dark": {"left": 0.1}, "gain": 2.0}
    spots = [(content, key) for key in content]
    spots += [(content["frames"][0], key) for key in ("name", "images")]
    spots += [(content["corrections"], key) for key in ("dark", "gain")]
    spots += [(content["grid"], key) for key in content["grid"]]
    holder, key = data.draw(st.sampled_from(spots))
    holder[key] = data.draw(ANYTHING)
    path.write_text(yaml.safe_dump(content, allow_unicode=True), encoding="utf-8")
    try:
        Scan.load(folder)
    except (ValueError, FileNotFoundError, IsADirectoryError) as error:
        assert len(str(error).splitlines()) == 1  # noqa: PT017
        assert "scan" in str(error)  # noqa: PT017


@settings(max_examples=60, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(st.binary(max_size=200) | st.text(max_size=200).map(lambda text: text.encode("utf-8")))
def test_any_bytes_are_refused_in_one_line(folder, content):
    (folder / "scan.yaml").write_bytes(content)
    assert_refused(lambda: Scan.load(folder), "scan.yaml")


@pytest.mark.parametrize("name", ["../x", "a/b", ".hidden", "", "a:b"])
def test_names_that_are_no_file_names(tmp_path, name):
    assert_refused(lambda: save_scan(tmp_path / "s", RIG, {name: FRAMES["first"]}), repr(name))
    assert not (tmp_path / "s").exists()


def test_saving_what_does_not_fit(tmp_path):
    wrong = {"left": np.zeros((7, 5), np.float32)}
    assert_refused(lambda: save_scan(tmp_path / "s", RIG, {"f": wrong}), "camera left", "(7, 5)")
    truth = np.zeros((2, 2, 2))
    assert_refused(lambda: save_scan(tmp_path / "s", RIG, FRAMES, truth=truth), "truth", "grid")
    assert not (tmp_path / "s").exists()


def test_corrections_of_a_scan_built_by_hand(tmp_path):
    """A scan is a value: no file but its images is needed."""
    write_image(tmp_path / "a.tif", FRAMES["first"]["left"])
    frame = Frame("only", {"left": tmp_path / "a.tif"})
    scan = Scan(RIG[:1], (frame,), Corrections(gain={"left": 2.0}))
    np.testing.assert_allclose(scan.images()[0], 2 * FRAMES["first"]["left"], rtol=1e-6)
