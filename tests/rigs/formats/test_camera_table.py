"""Tables of cameras: columns, units, and what is wrong with them."""

import numpy as np
import pytest

from rigs import camera_at, formats

HEAD = "name, x, y, z, look_x, look_y, look_z, focal_mm, pitch_um, width, height"
ROWS = (
    "left, -380, 40, 420, 0, 10, 0, 35, 5.5, 1024, 1280",
    "top, 180, 420, -240, 0, 10, 0, 25, 6, 900, 700",
)


def table(path, head=HEAD, rows=ROWS):
    path.write_text("\n".join([head, *rows, ""]), "utf-8")
    return path


def test_a_table_gives_the_cameras_that_its_figures_describe(tmp_path):
    rig = formats.load(
        table(
            tmp_path / "cameras.csv",
            HEAD.replace(" x,", " x_mm,")
            .replace(" y,", " y (mm),")
            .replace(" z,", " z [mm],")
            .replace("look_x", "look_x_mm")
            .replace("look_y", "look_y_mm")
            .replace("look_z", "look_z_mm"),
        )
    )
    assert formats.sniff(tmp_path / "cameras.csv") == "camera_table"
    assert rig.length_unit == "mm"
    assert rig.names == ("left", "top")
    assert {camera.status for camera in rig} == {"nominal"}
    points = [[0, 10, 0], [20, -5, 8]]
    for camera, place, lens, size in (
        (rig["left"], (-380, 40, 420), (35, 0.0055), (1024, 1280)),
        (rig["top"], (180, 420, -240), (25, 0.006), (900, 700)),
    ):
        known = camera_at(
            "a", place, (0, 10, 0), image_size=size, focal_length=lens[0], pixel_pitch=lens[1]
        )
        np.testing.assert_allclose(camera.project(points)[0], known.project(points)[0], rtol=1e-12)


def test_units_are_kept_and_spreadsheets_of_any_country_are_read(tmp_path):
    text = (HEAD + ", up_x, up_y, up_z").replace(",", ";")
    rows = ["left; 0,5; 0; 0; 0; 0; 0; 35; 5,5; 64; 48; 0; 0; 1"]
    (camera,) = formats.load(table(tmp_path / "a.csv", text, rows))
    np.testing.assert_allclose(camera.position, [0.5, 0, 0])
    assert camera.camera_matrix[0, 0] == pytest.approx(35 / 0.0055)
    assert camera.project([[0, 0, 0.001]])[0][0, 1] < 23.5  # z points to the top
    assert formats.load(tmp_path / "a.csv").length_unit == "unit"
    pixels = "camera,x_m,y_m,z_m,look_x_m,look_y_m,look_z_m,focal_pixels"
    path = table(tmp_path / "b.csv", pixels, ["left,1,0,0,0,0,0,900"])
    (camera,) = rig = formats.load(path, image_size=(64, 48))
    assert rig.length_unit == "m"
    assert camera.camera_matrix[0, 0] == 900
    with pytest.raises(ValueError, match=r"b\.csv: camera left: image_size: missing"):
        formats.load(path)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ((" look_y,", " look_q,"), "look_y: missing among the columns, expected the"),
        ((" 420,", " far,"), "camera left: z: found ' far', expected a finite number"),
        ((" 420, 0,", " 420,"), "line 2: found 10 columns, expected 11"),
        ((" 35,", " ,"), "camera left: focal: missing, expected a number"),
        ((" 35,", " -35,"), "camera left: focal: found -35, expected a positive number"),
        (("pitch_um", "pitch"), "camera left: focal and pitch: found a unit of one alone"),
        (("pitch_um", "gap_um"), "gap: found among the columns, expected name, x, y, z"),
        (("top", "left"), "camera left: name: found twice"),
        ((" x,", " x_mm,"), "x ... look_z: found the units mm, none, expected one"),
        ((" 1024,", " 0.5,"), "camera left: width, height: found 0.5"),
    ],
)  # fmt: skip
def test_what_is_wrong_is_named(refused_as, tmp_path, change, message):
    path = table(tmp_path / "a.csv")
    path.write_text(path.read_text().replace(*change))
    refused_as(path, message, path, "camera_table")


@pytest.mark.parametrize(
    ("more", "words"),
    [("k1", "k1: found among the columns"), ("model", "model: found"), ("up_x", "up: found up_x")],
)
def test_no_column_is_left_out_silently(tmp_path, more, words):
    rows = [f"{row}, 0.1" for row in ROWS]
    with pytest.raises(ValueError, match=rf"a\.csv: {words}"):
        formats.load(table(tmp_path / "a.csv", f"{HEAD}, {more}", rows))
