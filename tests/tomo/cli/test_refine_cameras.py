"""``reconstruct.py --refine-cameras``: what it writes, what it says, what it refuses."""

import json
from dataclasses import replace

import numpy as np
import pytest

from phantoms import create
from rigs import box_points, load_rig, ray_miss, ring
from tomo import VoxelGrid, load_scan
from tomo.pipeline import Options, reconstruct
from tomo.simulation import simulate_images

GRID = VoxelGrid((10, 20, 10), 1.0)
FOOTPRINT = 0.7
QUICK = ("--method", "sirt", "--iterations", "2", "--uncertainty", "0", "--no-pictures")
QUICK += ("--no-screen", "--no-fit-absorption")
BOX = box_points(GRID.lower, GRID.upper, 4)


@pytest.fixture(scope="module")
def rig():
    return ring(
        7,
        distance=400,
        image_size=(31, 46),
        footprint=FOOTPRINT,
        pitch_degrees=([12, -9, 3] * 3)[:7],
    )


@pytest.fixture(scope="module")
def scan(tmp_path_factory, rig, disturbed):
    """A scan whose rig.yaml says of each camera a pixel of nonsense."""
    flame = create("turbulent", extent=GRID.extent, seed=2)
    made = simulate_images(rig, flame, GRID, supersample=2, refine=2, noise=0.01, seed=2)
    folder = tmp_path_factory.mktemp("disturbed") / "scan"
    replace(made, rig=disturbed(rig, GRID, 8, 0.6)).save(folder)
    return folder


@pytest.fixture(scope="module")
def done(run_tool, scan, tmp_path_factory):
    out = tmp_path_factory.mktemp("done") / "out"
    options = ("--refine-cameras", "all", "--hold-out", "cam04", "--json")
    options += QUICK
    result = run_tool("reconstruct", scan, *options, "-o", out)
    assert result.exit_code == 0, result.stderr
    return out, result


def test_the_refined_rig_is_written_and_better(done, scan, rig):
    out, _ = done
    given, found = load_rig(scan / "rig.yaml"), load_rig(out / "refined_rig.yaml")
    names = [name for name in rig.names if name != "cam04"]
    before, after = (
        ray_miss(rig.without("cam04"), one.without("cam04"), BOX) for one in (given, found)
    )
    assert after < 0.4 * before
    assert found["cam04"] == given["cam04"]  # held out: nobody has seen its image
    refined = found.calibration["refined_from_images"]
    assert sorted(refined["cameras"]) == sorted(names)


def test_the_report_says_what_was_refined(done):
    out, result = done
    report = json.loads((out / "report.json").read_text("utf-8"))
    assert json.loads(result.stdout) == report
    refinement = report["refinement"]
    assert refinement["accepted"] is True
    assert refinement["held_out_error_after"] < refinement["held_out_error_before"]
    assert "cam04" not in refinement["cameras"]
    page = (out / "report.html").read_text("utf-8")
    section = page.split("<h2>Which cameras were moved?</h2>")[1].split("<h2>")[0]
    assert refinement["reason"] in section
    assert section.count('<th scope="row">') == 6
    assert "cameras refined from the images" in result.stderr.replace("\n", " ")


def test_a_scan_s_own_rig_stays_and_a_refined_one_goes_with_its_outcome(
    run_tool, scan, nothing_sought
):
    """The refined rig is that of the recorded images, where shrunk ones were used too."""
    before = (scan / "rig.yaml").read_bytes()
    quick = (*QUICK, "--scale", "2", "-o", scan)
    refine = ("--refine-cameras", "cam02,cam03,none")
    assert run_tool("reconstruct", scan, *quick, *refine).exit_code == 0
    refined, given = load_rig(scan / "refined_rig.yaml"), load_rig(scan / "rig.yaml")
    assert [camera.image_size for camera in refined] == [(31, 46)] * 7
    apart = [
        np.abs(one.project(BOX)[0] - other.project(BOX)[0]).max()
        for one, other in zip(refined, given, strict=True)
    ]
    assert min(apart[2:4]) > 0.1
    assert max(apart[:2] + apart[4:]) < 1e-9
    assert run_tool("reconstruct", scan, *quick, *nothing_sought).exit_code == 0
    assert not (scan / "refined_rig.yaml").exists()
    assert (scan / "rig.yaml").read_bytes() == before


def test_refined_on_one_moment_the_plume_is_predicted_better_at_another(test_data, as_given):
    """The two cameras that carry only an average field of view, refined on the other frame.

    One plain method on images as they are is enough to judge cameras by the three others.
    """
    whole = load_scan(test_data / "scalarflow" / "transforms.json")
    grid = VoxelGrid.from_bounds(
        (32, 48, 32), (0.0818, -0.0446, -0.4958), (0.5727, 0.6917, -0.0049)
    )
    nominal = ("cam00", "cam04")
    cameras = (replace(c, status="nominal") if c.name in nominal else c for c in whole.rig)
    whole = replace(whole, rig=replace(whole.rig, cameras=tuple(cameras)))
    plain = as_given | {"method": "sirt", "iterations": 20}
    refined = Options(frame="frame_060", **plain | {"refine_cameras": nominal})
    other = reconstruct(whole.scaled(12), grid, refined)
    assert other.refinement["accepted"]

    def predicted(scan):
        figures = []
        for camera in ("cam01", "cam02", "cam03"):
            options = Options(frame="frame_090", hold_out=[camera], **plain)
            outcome = reconstruct(scan.scaled(12), grid, options)
            figures.append(outcome.report()["held_out"][camera]["psnr"])
        return np.mean(figures)

    assert predicted(replace(whole, rig=other.refined_rig)) > predicted(whole) + 0.5


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (("nominal",), "refine_cameras: found no nominal camera in the rig"),
        (("cam01", "--hold-out", "cam01"), "refine_cameras: found only cameras held out: cam01"),
        (("all", *(f"--hold-out=cam0{n}" for n in range(5))), "found 2 views to refine with, exp"),
    ],
)
def test_bad_requests_are_one_line(refused, scan, tmp_path, options, words):
    given = (scan, "-o", tmp_path / "out", "--refine-cameras", *options)
    assert words in refused("reconstruct", *given)
