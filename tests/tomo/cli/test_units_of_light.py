"""The unit of light stands in every file and on every page; a bad calibration is one line."""

import json
import shutil

import h5py
import numpy as np
import pytest
import tifffile
import yaml

from rigs import ring, save_rig
from tomo import VoxelGrid
from tomo.io.volumes import read_volume
from tomo.operators import LinearSystem
from tomo.series import SeriesStore

UNIT, PER_COUNT = "W/m^3/sr", 2.0e-4
GRID = VoxelGrid((10, 10, 10), 1.0)


@pytest.fixture(scope="module")
def scan(tmp_path_factory):
    """Return a scan folder of films with a calibration: scan.yaml, and the light in W/sr."""
    folder = tmp_path_factory.mktemp("scan")
    rig = ring(4, distance=200.0, image_size=(20, 20), footprint=0.8, pitch_degrees=10.0)
    system = LinearSystem.from_rig(rig, GRID, skip=False)
    volume = 1e3 * np.exp(-((GRID.centers() / 2) ** 2).sum(axis=-1)).astype(np.float32)  # W/m^3/sr
    images = system.images(system.projector @ volume.ravel())  # times mm: 1e-3 W/m^2/sr
    for name, image in zip(rig.names, images, strict=True):
        counts = np.round(image * 1e-3 / PER_COUNT).astype(np.uint16)
        tifffile.imwrite(folder / f"{name}.tif", np.array([counts] * 2), photometric="minisblack")
    save_rig(rig, folder / "rig.yaml")
    content = {
        "format": "emission-scan", "version": 1, "rig": "rig.yaml", "grid": GRID.to_mapping(),
        "films": {name: f"{name}.tif" for name in rig.names},
        "radiometry": {"unit": "W/m^2/sr", "calibration": {"factor": PER_COUNT}},
    }  # fmt: skip
    (folder / "scan.yaml").write_text(yaml.safe_dump(content), "utf-8")
    return folder / "scan.yaml", 1e-9 * float(volume.sum(dtype=np.float64))


def test_a_reconstruction_names_its_unit_everywhere(scan, run_tool, nothing_sought, tmp_path):
    path, total = scan
    done = run_tool(
        "reconstruct", path, "--method", "mlem", *nothing_sought, "-o", tmp_path / "out", "--json"
    )
    assert done.exit_code == 0, done.stderr
    report = json.loads((tmp_path / "out/report.json").read_text())
    assert report["scan"]["value_unit"] == report["emission"]["unit"] == UNIT
    assert report["emission"]["total_unit"] == "W/sr"
    assert report["emission"]["total"] == pytest.approx(total, rel=0.02)
    assert report["scan"]["radiometry"]["per_count"]["cam00"] == pytest.approx(PER_COUNT * 1000)
    page = (tmp_path / "out/report.html").read_text("utf-8")
    assert "reconstructed emission in W/m³/sr" in page
    assert f"{report['emission']['power']:.4g} W" in page
    for ending in ("npz", "vti", "nrrd"):
        data, *_ = read_volume(tmp_path / f"out/volume.{ending}")
        assert data.value_unit == UNIT
        assert 1e-9 * data.sum(dtype=np.float64) == pytest.approx(total, rel=0.02)
    drawn = tmp_path / "drawn.html"
    done = run_tool("visualize_volume", tmp_path / "out/volume.nrrd", "-o", drawn, "--json")
    assert json.loads(done.stdout)["value_unit"] == UNIT
    integral = json.dumps(f"{UNIT} × mm".replace("^3", "³"))
    page = drawn.read_text("utf-8").replace("\\u002f", "/")
    assert f'"integral_unit": {integral}' in page


def test_a_film_and_its_exports_name_their_unit(scan, run_tool, nothing_sought, tmp_path):
    path, total = scan
    store = tmp_path / "out.zarr"
    done = run_tool(
        "reconstruct", path, "--frames", "0:2", "--method", "mlem", *nothing_sought, "-o", store
    )
    assert done.exit_code == 0, done.stderr
    opened = SeriesStore(store)
    assert opened.group["emission"].attrs["units"] == opened.attributes["value_unit"] == UNIT
    assert opened.group["total_emission"].attrs["units"] == "W/sr"
    np.testing.assert_allclose(opened.group["total_emission"][:], total, rtol=0.02)
    assert "W/sr" in (tmp_path / "out_report.html").read_text("utf-8")
    assert run_tool("export", store, "--to", "vtkhdf", "-o", tmp_path / "a.vtkhdf").exit_code == 0
    with h5py.File(tmp_path / "a.vtkhdf") as file:
        assert file["VTKHDF/PointData/emission"].attrs["units"] == UNIT
    assert run_tool("export", store, "--to", "npz", "-o", tmp_path / "files").exit_code == 0
    for written in (tmp_path / "files").iterdir():
        assert read_volume(written)[0].value_unit == UNIT


def test_a_wrong_calibration_is_one_line(scan, refused, edit, tmp_path):
    shutil.copytree(scan[0].parent, tmp_path / "scan")
    calibration = {"factor": {"cam9": 1.0}}
    edit(tmp_path / "scan/scan.yaml", lambda s: s["radiometry"].update(calibration=calibration))
    line = refused("reconstruct", tmp_path / "scan", "-o", tmp_path / "out")
    assert "radiometry.calibration.factor: found" in line
