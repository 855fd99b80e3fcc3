"""What is found in a folder by names: images, dark and flat frames, a rig."""

from pathlib import PurePosixPath

import numpy as np
import pytest

import rigs
from rigs import formats
from rigs.recordings import write_image
from tomo import load_scan
from tomo.scan.propose import Request, UndecidedError, propose_scan, write_proposal
from tomo.scan.propose.contents import kind_of

GIVEN = {"box": ((-1, -8, -3), (7, 4, 5)), "voxel": 1.0}  # the box has tests of its own

LAYOUTS = {
    "{c}/{f}.tif": ("dark/{c}/{f}.tif", "{camera}/{frame}.tif", "dark"),
    "raw/{c}_{f}.tif": ("{c}/dark/{f}.tif", "raw/{camera}_{frame}.tif", "{camera}/dark"),
    "images/{f}/{c}.png": ("dark_{c}.tif", "images/{frame}/{camera}.png", "dark_{camera}.tif"),
    "x/{c}/{f}.tif": ("x/{c}/dark_{f}.tif", "x/{camera}/{frame}.tif", "x/{camera}/dark_*.tif"),
    "{c}-{f}.tif": ("background/{c}-{f}.tif", "{camera}-{frame}.tif", "background"),
}


@pytest.mark.parametrize("layout", LAYOUTS)
def test_images_and_dark_frames_are_found_in_usual_layouts(laid_out, scene, layout):
    dark, pattern, value = LAYOUTS[layout]
    found = propose_scan(laid_out(layout, dark), Request(**GIVEN))
    assert found.images.pattern == pattern
    assert found.corrections == {"dark": value}
    assert len(found.scan.frames) == 2
    written = load_scan(write_proposal(found))
    for camera, image in zip(scene.rig.names, written.images("0002"), strict=True):
        light = scene.images[camera] / max(i.max() for i in scene.images.values())
        # noise of 4 counts, that of the mean of one or two dark frames, rounding
        np.testing.assert_allclose(image * 65535, 3400 * light, atol=40)
    for own, other in zip(found.scan.read(), written.read(), strict=True):
        np.testing.assert_array_equal(own, other)
    assert written.grid == found.grid
    assert written.rig == scene.rig


def test_a_film_a_camera_is_a_scan_of_its_frames(scene, counts, tmp_path):
    for camera in scene.rig.names:
        film = np.stack([counts(camera, 0.2 + 0.4 * moment) for moment in range(3)])
        (tmp_path / "films").mkdir(exist_ok=True)
        import tifffile

        tifffile.imwrite(tmp_path / "films" / f"{camera}.tif", film, photometric="minisblack")
    rigs.save_rig(scene.rig, tmp_path / "rig.yaml")
    found = propose_scan(tmp_path, Request(**GIVEN))
    assert found.images.pattern == "films/{camera}.tif"
    written = load_scan(write_proposal(found))
    assert len(written.frames) == 3
    np.testing.assert_array_equal(written.images("2"), found.scan.images("2"))


def test_names_say_what_frames_show():
    dark = (
        "dark/a.tif",
        "a/darks/1.tif",
        "a_dark_1.tif",
        "Dark2.tif",
        "DarkFrames/a.tif",
        "background1.tif",
    )
    assert {kind_of(PurePosixPath(one)) for one in dark} == {"dark"}
    assert {kind_of(PurePosixPath(one)) for one in ("flat/a.tif", "a-flatfield.tif")} == {"flat"}
    other = "darker/a.tif", "inflatable.tif", "flatter_1.tif", "cam0/1.tif"
    assert {kind_of(PurePosixPath(one)) for one in other} == {""}


def test_flat_frames_and_one_dark_image_for_all_are_found(laid_out, scene):
    folder = laid_out("{c}/{f}.tif", frames=("1",))
    size = scene.rig[0].image_size[::-1]
    write_image(folder / "dark.tif", np.full(size, 100, np.uint16))
    for camera in scene.rig.names:
        write_image(folder / "flat" / f"{camera}.tif", np.full(size, 40000, np.uint16))
    found = propose_scan(folder, Request(**GIVEN))
    assert found.corrections == {"dark": "dark.tif", "flat": "flat/{camera}.tif"}
    assert any(line.startswith("assumed: ") for line in found.said["flat"])
    left = propose_scan(folder, Request(flat="none", dark=0.001, **GIVEN))
    assert left.corrections == {"dark": 0.001}


def test_rigs_of_any_format_and_tables_are_found_and_written_as_ours(laid_out, scene, counts):
    folder = laid_out("{c}/{f}.tif", rig=None)
    (folder / "calibration").mkdir()
    formats.save(scene.rig, folder / "calibration" / "rig.yml", "opencv")
    found = propose_scan(folder, Request(**GIVEN))
    assert found.rig is not None
    write_proposal(found)
    text = (folder / "rig.yaml").read_text("utf-8")
    assert text.startswith(
        "# Written by flametomo init\n# 6 cameras from calibration/rig.yml (opencv)"
    )
    assert load_scan(folder).rig.names == scene.rig.names

    (folder / "rig.yaml").unlink()
    (folder / "calibration" / "rig.yml").unlink()
    rows = ["name,x,y,z,look_x,look_y,look_z,focal_mm,pitch_um"]
    for number, camera in enumerate(scene.rig):
        looks = camera.position + 200 * camera.R[2]
        places = ",".join(f"{value:.4f}" for value in (*camera.position, *looks))
        rows.append(f"Cam-{number},{places},{camera.camera_matrix[0, 0] / 100:.6f},10")
    (folder / "cameras.csv").write_text("\n".join(rows), "utf-8")
    found = propose_scan(folder, Request(length_unit="mm", **GIVEN))
    assert found.scan.rig.names == scene.rig.names  # Cam-0 is cam00
    assert found.scan.rig[0].image_size == (60, 72)  # that of the images
    said = " ".join(found.said["rig"])
    assert "assumed: names of cameras that differ in writing alone mean the same" in said
    points = [[3, -2, 1], [5, 0, 0]]
    for one, other in zip(found.scan.rig, scene.rig, strict=True):
        np.testing.assert_allclose(one.project(points)[0], other.project(points)[0], atol=0.01)


def test_a_rig_yaml_comes_first_and_stays_as_it_is(laid_out, scene):
    folder = laid_out("{c}/{f}.tif")
    formats.save(scene.rig, folder / "other.yml", "opencv")
    before = (folder / "rig.yaml").read_bytes()
    found = propose_scan(folder, Request(**GIVEN))
    assert found.rig is None
    assert "not used: other.yml" in found.said["rig"][1]
    write_proposal(found)
    assert (folder / "rig.yaml").read_bytes() == before
    (folder / "rig.yaml").rename(folder / "a.yaml")
    with pytest.raises(UndecidedError, match=r"rigs: found a\.yaml and other\.yml, expected one"):
        propose_scan(folder)
    (folder / "scan.yaml").unlink()
    chosen = propose_scan(folder, Request(rig="other.yml", **GIVEN))
    assert chosen.said["rig"][0].endswith("other.yml (opencv), named")


def test_twelve_bits_are_seen_where_pixels_show_them(laid_out, scene, counts):
    folder = laid_out("{c}/{f}.tif", frames=("1",))
    for camera in scene.rig.names:
        image = np.minimum(counts(camera, 1.6), 4095)
        write_image(folder / camera / "1.tif", image.astype(np.uint16))
    found = propose_scan(folder, Request(**GIVEN))
    assert found.corrections == {"bit_depth": 12}
    assert found.said["bit_depth"][0].startswith("assumed: cameras of 12 bits")


def test_a_bit_depth_that_unsaturated_pixels_leave_open_is_named(laid_out):
    found = propose_scan(laid_out("{c}/{f}.tif", frames=("1",)), Request(**GIVEN))
    assert found.corrections == {}
    (line,) = found.said["bit_depth"]
    assert "--bit-depth 12" in line
    assert "16 times too faint" in line


def test_images_in_two_places_are_named_and_the_option_decides(laid_out, scene):
    folder = laid_out("run1/{c}/{f}.tif", "run1/{c}/dark/{f}.tif")
    laid_out("run2/{c}/{f}.tif", "run2/{c}/dark/{f}.tif")
    with pytest.raises(UndecidedError, match=r"found run1/.* and run2/.*, expected one") as caught:
        propose_scan(folder)
    assert caught.value.option == "pattern"
    found = propose_scan(folder, Request(pattern=caught.value.choices[1], **GIVEN))
    assert found.images.pattern == "run2/{camera}/{frame}.tif"
    assert found.corrections == {"dark": "run2/{camera}/dark"}  # those beside the images
    (folder / "run1").rename(folder / "images")
    usual = propose_scan(folder, Request(**GIVEN))
    assert usual.images.pattern == "images/{camera}/{frame}.tif"
    assert "not used: run2/{camera}/{frame}.tif" in usual.said["images"][1]


def test_hostile_names_stay_inside_their_comments_and_values(laid_out, scene):
    folder = laid_out(
        "ab: c # {{x}}\u202e'- *y/{c}/{f}.tif", '#\x1b[2J"dark/{c}.tif', frames=("1",)
    )
    found = propose_scan(folder, Request(**GIVEN))
    written = load_scan(write_proposal(found))
    np.testing.assert_array_equal(written.images(), found.scan.images())
    assert written.corrections == found.scan.corrections
    assert "\x1b" not in (folder / "scan.yaml").read_text("utf-8")
    broken = laid_out("a\x85b/{c}/{f}.tif", name="broken")
    with pytest.raises(
        ValueError, match=r"images: camera cam00: found .*, expected a path inside"
    ):
        propose_scan(broken)


def test_the_rig_written_is_that_of_whole_images_of_a_mosaic(laid_out, scene):
    folder = laid_out("{c}/{f}.tif", rig=None)
    formats.save(scene.rig, folder / "rig.yml", "opencv")
    found = propose_scan(folder, Request(bayer="RGGB", channel="g", **GIVEN))
    scan = load_scan(write_proposal(found))
    assert rigs.load_rig(folder / "rig.yaml")[0].image_size == scene.rig[0].image_size
    assert scan.images()[0].shape == found.scan.images()[0].shape
