"""OpenPTV's projects, written here by liboptv's formulas."""

import re

import numpy as np
import pytest
from scipy.optimize import brentq

from rigs import RayTable, formats


def write_openptv(folder, cameras, size=(1280, 1024), pitch=(0.012, 0.0125), indices=(1, 1, 1)):
    (folder / "parameters").mkdir(parents=True, exist_ok=True)
    (folder / "cal").mkdir(exist_ok=True)
    lines = [len(cameras)]
    for index, (exterior, interior, lens) in enumerate(cameras, 1):
        lines += [f"img/cam{index}.10002", f"cal/cam{index}.tif"]
        ori = [*exterior, *[0.0] * 9, *interior, 0.0, 0.0, 50.0]  # the matrix is a copy
        (folder / f"cal/cam{index}.tif.ori").write_text(" ".join(repr(float(v)) for v in ori))
        (folder / f"cal/cam{index}.tif.addpar").write_text(" ".join(map(repr, lens)))
    lines += [1, 0, 1, *size, *pitch, 0, *indices, 6]
    (folder / "parameters/ptv.par").write_text("\n".join(map(str, lines)) + "\n")
    return folder


def openptv_pixels(points, exterior, interior, lens, size, pitch):
    """Pixel coordinates by liboptv's imgcoord and trafo."""
    omega, phi, kappa = exterior[3:]
    co, so, cp, sp, ck, sk = (f(a) for a in (omega, phi, kappa) for f in (np.cos, np.sin))
    dm = np.array(
        [
            [cp * ck, -cp * sk, sp],
            [co * sk + so * sp * ck, co * ck - so * sp * sk, -so * cp],
            [so * sk - co * sp * ck, so * ck + co * sp * sk, co * cp],
        ]
    )
    d = (points - exterior[:3]) @ dm
    assert (d[:, 2] < 0).all()  # in front
    xh, yh, cc = interior
    x, y = xh - cc * d[:, 0] / d[:, 2], yh - cc * d[:, 1] / d[:, 2]
    k1, k2, k3, p1, p2, scx, she = lens
    q = x * x + y * y
    gain = k1 * q + k2 * q**2 + k3 * q**3
    x, y = (
        x + x * gain + p1 * (q + 2 * x * x) + 2 * p2 * x * y,
        y + y * gain + p2 * (q + 2 * y * y) + 2 * p1 * x * y,
    )
    x, y = scx * x - np.sin(she) * y, np.cos(she) * y
    return np.stack([x / pitch[0] + size[0] / 2, size[1] / 2 - y / pitch[1]], axis=-1)


SMALL, COARSE = (320, 256), (0.048, 0.05)  # an image size and a pixel pitch in mm
OPENPTV = [
    (
        [120.0, 50.0, 600.0, -0.05, 0.2, 0.01],
        [0, 0, 60],
        [-4e-4, 1e-7, 0, 2e-5, -3e-5, 1.01, 2e-3],
    ),
    ([-90.0, 40.0, 500.0, -0.1, -0.2, 3.1], [0.3, -0.2, 55.0], [0, 0, 0, 0, 0, 1.0, 0.0]),
]


def test_openptv(tmp_path):
    folder = write_openptv(tmp_path, OPENPTV)
    assert formats.sniff(folder) == "openptv"
    rig = formats.load(folder)
    assert rig.names == ("cam1", "cam2")
    points = np.random.default_rng(0).uniform(-30, 30, (200, 3))
    for camera, values in zip(rig, OPENPTV, strict=True):
        expected = openptv_pixels(points, *values, (1280, 1024), (0.012, 0.0125))
        uv, _, valid = camera.project(points)
        assert valid.all()
        np.testing.assert_allclose(uv + 0.5, expected, atol=1e-6)  # its centres are at halves
    for path in ("parameters/ptv.par", "cal/cam1.tif.ori"):
        assert formats.load(folder / path)["cam1"] == rig["cam1"]


def test_openptv_projects_of_windows_have_backslashes(tmp_path):
    folder = write_openptv(tmp_path, OPENPTV)
    rig = formats.load(folder)
    parameters = folder / "parameters/ptv.par"
    parameters.write_text(parameters.read_text().replace("cal/", "cal\\"))
    assert formats.load(folder).cameras == rig.cameras
    parameters.write_text(parameters.read_text().replace("cal\\", "..\\cal\\"))
    with pytest.raises(ValueError, match="expected a path inside"):
        formats.load(folder)


def test_openptv_with_a_lens_round_another_centre_is_a_table_of_rays(tmp_path):
    values = (OPENPTV[0][0], [0.3, -0.2, 60.0], OPENPTV[0][2])
    size, pitch = SMALL, COARSE
    camera = formats.load(write_openptv(tmp_path, [values], size, pitch))["cam1"]
    assert isinstance(camera, RayTable)
    uv = np.random.default_rng(0).integers([0, 0], size, (200, 2)).astype(float)
    origins, directions = camera.rays(uv)
    points = origins + directions * np.linspace(300, 900, 200)[:, None]
    expected = openptv_pixels(points, *values, size, pitch)
    np.testing.assert_allclose(uv + 0.5, expected, rtol=0, atol=1e-6)
    points = np.random.default_rng(0).uniform(-30, 30, (200, 3))
    uv, _, valid = camera.project(points)
    assert valid.all()
    np.testing.assert_allclose(uv + 0.5, openptv_pixels(points, *values, size, pitch), atol=1e-3)


SEEN_POINTS = [[10.0, -20, 5], [-25, 15, -10], [0, 0, 0]]
INDICES, THICKNESS = (1.0, 1.46, 1.33), 6.0  # of air, glass and water
#: Pixels of `SEEN_POINTS` by optv 0.3.2 behind that glass, its vectors (0, 0, 50) and (5, 3, 60).
SEEN_BEHIND = {
    (0.0, 0.0, 50.0): [
        [182.802279, 213.964906],
        [116.736218, 141.997638],
        [163.853301, 173.325604],
    ],
    (5.0, 3.0, 60.0): [
        [184.622781, 212.983675],
        [118.847202, 140.350103],
        [165.823286, 172.041300],
    ],
}


def write_behind(folder, glass, indices=INDICES):
    (exterior, _, lens), _ = OPENPTV
    camera = exterior, [0.3, -0.2, 60.0], [*lens[:5], 1.0, lens[6]]
    write_openptv(folder, [camera], SMALL, COARSE, indices)
    ori = folder / "cal/cam1.tif.ori"
    words = ori.read_text().split()[:18]
    ori.write_text(" ".join([*words, *map(repr, glass)]))
    return camera


@pytest.mark.parametrize("glass", SEEN_BEHIND)
def test_points_behind_glass_appear_where_openptvs_own_library_puts_them(tmp_path, glass):
    write_behind(tmp_path, glass)
    uv, _, valid = formats.load(tmp_path)[0].project(SEEN_POINTS)
    assert valid.all()
    # optv finds them by an iteration; the table interpolates
    np.testing.assert_allclose(uv + 0.5, SEEN_BEHIND[glass], rtol=0, atol=2e-4)


def apparent(point, eye, glass):
    """Where a point behind the window seems to be: on the line of sight that Snell's law asks for.

    The angle before the window is found by how far the ray gets along it.
    """
    n = np.array(glass) / np.linalg.norm(glass)
    depths = (
        eye @ n - np.linalg.norm(glass) - THICKNESS,
        THICKNESS,
        np.linalg.norm(glass) - point @ n,
    )
    along = point - eye - ((point - eye) @ n) * n
    far = np.linalg.norm(along)

    def missing(sine):  # of the angle before the window
        sines = [sine * INDICES[0] / index for index in INDICES]
        return sum(d * s / np.sqrt(1 - s * s) for d, s in zip(depths, sines, strict=True)) - far

    sine = brentq(missing, 0, 0.99, xtol=1e-16, rtol=1e-15)
    return eye + sine * along / far - np.sqrt(1 - sine**2) * n


@pytest.mark.parametrize("glass", SEEN_BEHIND)
def test_rays_obey_snells_law(tmp_path, glass):
    exterior, interior, lens = write_behind(tmp_path, glass)
    camera = formats.load(tmp_path)[0]
    uv = np.random.default_rng(0).integers([0, 0], SMALL, (200, 2)).astype(float)
    origins, directions = camera.rays(uv)
    points = origins + directions * np.linspace(1, 300, 200)[:, None]
    eye = np.array(exterior[:3])
    seen = np.array([apparent(point, eye, glass) for point in points])
    expected = openptv_pixels(seen, exterior, interior, lens, SMALL, COARSE)
    np.testing.assert_allclose(uv + 0.5, expected, rtol=0, atol=1e-6)


def test_glass_that_does_not_bend_is_none(tmp_path):
    air = formats.load(write_openptv(tmp_path / "a", OPENPTV[1:]))
    water = formats.load(write_openptv(tmp_path / "b", OPENPTV[1:], indices=(1.33,) * 3))
    assert water.cameras == air.cameras


@pytest.mark.parametrize(
    ("glass", "indices", "file", "message"),
    [
        ((), INDICES, "cal/cam1.tif.ori", "camera cam1: glass_x: missing, expected the way to"),
        ((0.0, 0.0, 0.0), INDICES, "cal/cam1.tif.ori", "camera cam1: glass_x, glass_y, glass_z"),
        ((0.0, 0.0, 700.0), INDICES, "cal/cam1.tif.ori", "camera cam1: glass_x, glass_y, glass_z"),
        ((0.0, 0.0, 50.0), (1, 0, 1.33), "parameters/ptv.par", "n1, n2, n3: found [1.0, 0.0"),
    ],
)
def test_what_is_wrong_with_the_glass_is_named(
    refused_as, tmp_path, glass, indices, file, message
):
    write_behind(tmp_path, glass, indices)
    refused_as(tmp_path / file, message, tmp_path)


def test_what_is_wrong_in_openptvs_files_is_named(tmp_path):
    folder = write_openptv(tmp_path, OPENPTV)
    parameters, ori = folder / "parameters/ptv.par", folder / "cal/cam2.tif.ori"
    good = parameters.read_text()
    for old, new, message in (
        ("1280", "wide", "imx: found 'wide'"),
        ("0.012\n", "-1\n", "pix_x: found -1.0, expected a positive"),
        ("cal/cam1.tif", "../x/cam1.tif", "calibration image: found '../x/cam1.tif'"),
        ("2\n", "9\n", "found 17 lines, expected 31 for 9 cameras: their"),
    ):
        parameters.write_text(good.replace(old, new, 1))
        with pytest.raises(ValueError, match=re.escape(f"{parameters}: {message}")):
            formats.load(folder)
    parameters.write_text(good)
    ori.write_text("1 2 3")
    with pytest.raises(ValueError, match=re.escape(f"{ori}: found 3 values, expected 18: x0 y0")):
        formats.load(folder)
    ori.unlink()
    with pytest.raises(FileNotFoundError, match=r"cam2.tif.ori: no such file"):
        formats.load(folder)


#: Pixels of `SEEN_POINTS` by optv 0.3.2's ``image_coordinates``: of `OPENPTV` with scx = 1, and of
#: its first camera with xh, yh = 0.3, -0.2.
SEEN = [
    [[181.724356, 207.041580], [118.724023, 136.136601], [163.625606, 166.999143]],
    [[167.613287, 109.680138], [252.644969, 184.465892], [192.875943, 152.801738]],
    [[187.917823, 210.941497], [124.957935, 140.133917], [169.871770, 170.977721]],
]


def test_points_appear_where_openptvs_own_library_puts_them(tmp_path):
    (exterior, interior, lens), second = OPENPTV
    lens = [*lens[:5], 1.0, lens[6]]
    cameras = [(exterior, interior, lens), second, (exterior, [0.3, -0.2, 60.0], lens)]
    rig = formats.load(write_openptv(tmp_path, cameras, SMALL, COARSE))
    for camera, expected in zip(rig, SEEN, strict=True):
        near = 2e-6 if camera.has_lens_model else 2e-4  # between the rays of a table
        uv, _, valid = camera.project(SEEN_POINTS)
        assert valid.all()
        np.testing.assert_allclose(uv + 0.5, expected, rtol=0, atol=near)


def test_a_stretch_that_versions_read_differently_is_named(tmp_path, caplog):
    formats.load(write_openptv(tmp_path, OPENPTV[1:]))
    assert not caplog.records
    formats.load(write_openptv(tmp_path, OPENPTV[:1]))
    assert "camera cam1: scx: found 1.01, taken as 3D-PTV and liboptv do" in caplog.text
    assert "up to 5.1 px at the image's edge" in caplog.text


def parameters(folder):
    return folder / "parameters" / "ptv.par"


def test_every_path_of_a_project_names_it(tmp_path):
    folder = write_openptv(tmp_path, OPENPTV)
    rig = formats.load(folder)
    for path in ("cal", "parameters", "parameters/ptv.par"):
        assert formats.sniff(folder / path) == "openptv"
        assert formats.load(folder / path).cameras == rig.cameras
    for path in ("cal/cam2.tif.ori", "cal/cam2.tif.addpar"):
        assert formats.load(folder / path).cameras == (rig["cam2"],)


def test_runs_of_parameters_must_agree(tmp_path):
    folder = write_openptv(tmp_path, OPENPTV)
    rig = formats.load(folder)
    for run in ("parametersRun1", "parametersRun2"):
        (folder / run).mkdir()
        (folder / run / "ptv.par").write_text(parameters(folder).read_text())
    parameters(folder).unlink()
    assert formats.load(folder).cameras == rig.cameras
    assert formats.load(folder / "parametersRun2").cameras == rig.cameras
    other = folder / "parametersRun2" / "ptv.par"
    other.write_text(other.read_text().replace("1280", "640"))
    message = f"{folder}: found other cameras or sensors in {other} than in "
    with pytest.raises(ValueError, match=re.escape(message)):
        formats.load(folder)
    assert formats.load(folder / "parametersRun2")[0].image_size == (640, 1024)


@pytest.mark.parametrize("flags", [["1", "1"], ["1", "0", "1"]])
def test_the_files_of_3d_ptv_name_four_cameras(tmp_path, flags):
    """Its reader takes four rows of names, and its first version has no flag of all cameras."""
    folder = write_openptv(tmp_path, OPENPTV)
    rig = formats.load(folder)
    lines = parameters(folder).read_text().splitlines()
    filler = ["img/cam3.1", "cal/cam3.tif", "---", "---"]
    parameters(folder).write_text("\n".join([*lines[:5], *filler, *flags, *lines[8:]]) + "\n")
    assert formats.load(folder).cameras == rig.cameras


def test_older_orientations_have_no_glass(tmp_path):
    folder = write_openptv(tmp_path, OPENPTV)
    rig = formats.load(folder)
    ori = folder / "cal/cam1.tif.ori"
    ori.write_text(" ".join(ori.read_text().split()[:18]))
    assert formats.load(folder).cameras == rig.cameras


def yaml_of():
    return """num_cams: 2
ptv:
  imx: 1280
  imy: 1024
  pix_x: 0.012
  pix_y: 0.0125
  chfield: 0
  mmp_n1: 1.0
  mmp_n2: 1.0
  mmp_n3: 1.0
  mmp_d: 6.0
  img_cal:
  - cal/cam1.tif
  - cal/cam2.tif
  splitter: false
track:
  dacc: 0.24
"""


def test_the_yaml_of_pyptv(tmp_path):
    folder = write_openptv(tmp_path, OPENPTV)
    rig = formats.load(folder)
    file = folder / "parameters_Run1.yaml"
    file.write_text(yaml_of())
    assert formats.load(folder).cameras == rig.cameras  # both sets say the same
    parameters(folder).unlink()
    for path in (folder, file, folder / "cal"):
        assert formats.sniff(path) == "openptv"
        assert formats.load(path).cameras == rig.cameras


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("num_cams: 2", "num_cams: 3", "ptv: img_cal: found ['cal/cam1.tif', 'cal/cam2.tif'], ex"),
        ("cal/cam1.tif", "7", "ptv: img_cal: found [7, 'cal/cam2.tif'], expected names of images"),
        ("cal/cam1.tif", "../cam1.tif", "calibration image: found '../cam1.tif', expected a path"),
        ("  imx: 1280\n", "", "ptv: imx: missing, expected it in the file"),
        ("mmp_d: 6.0", "mmp_d: -1", "d: found -1.0, expected a thickness >= 0"),
    ],
)
def test_what_is_wrong_in_the_yaml_is_named(refused_as, tmp_path, old, new, message):
    file = tmp_path / "parameters_Run1.yaml"
    file.write_text(yaml_of().replace(old, new))
    refused_as(file, message, file)


def test_orientations_without_parameters_say_what_lacks(tmp_path):
    folder = write_openptv(tmp_path, OPENPTV)
    parameters(folder).unlink()
    for path in ("cal", "cal/cam1.tif.ori"):
        with pytest.raises(FileNotFoundError, match=r"found no ptv.par in it, .* pixel pitch"):
            formats.load(folder / path)
