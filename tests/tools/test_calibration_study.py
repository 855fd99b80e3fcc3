"""The study of calibration: its measure of truth, and the whole of it on a tiny rig."""

import json
from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from rigs import Rig, Volume, arc
from rigs.calibrate import Observations

VOLUME = Volume((10, 10, 10), 4.0)
RIG = arc(3, 60.0, 500.0, image_size=(300, 300), footprint=0.3, volume=VOLUME)


@pytest.fixture(scope="module")
def truth(run_tool):  # which puts tools/ on the path
    from _calibration import truth

    return truth


def test_a_rig_does_not_miss_itself_wherever_its_world_is(truth):
    assert truth.true_ray_miss(RIG, RIG, VOLUME) < 1e-10
    R = Rotation.from_rotvec([0.3, -1.2, 0.7]).as_matrix()
    assert truth.true_ray_miss(RIG, RIG.transformed(R, [40.0, -3.0, 900.0]), VOLUME) < 1e-9


def test_a_camera_that_looks_beside_misses_by_what_geometry_says(truth):
    """A camera lifted by h off the others' plane: least squares leaves h times sqrt(2) / 3.

    Three rays whose heights are 0, 0 and h have their best common point at h / 3.
    """
    lifted = replace(RIG[1], t=RIG[1].t + RIG[1].R @ [0.0, -0.06, 0.0])
    rig = Rig((RIG[0], lifted, RIG[2]))
    expected = 0.06 * np.sqrt(2) / 3
    assert truth.true_ray_miss(RIG, rig, VOLUME) == pytest.approx(expected, rel=0.01)


def test_only_images_with_every_point_are_complete(truth):
    points = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0]])
    camera, frame, point = np.array([[0, 0, 0], [0, 0, 1], [0, 0, 2], [1, 0, 0], [1, 0, 2]]).T
    sightings = Observations(
        points, ("a", "b"), ((9, 9),) * 2, ("f",), camera, frame, point, np.ones((5, 2))
    )
    kept = truth.of_complete_targets(sightings)
    assert kept.counts().tolist() == [[3], [0]]
    assert kept.cameras == ("a", "b")
    np.testing.assert_array_equal(truth.in_metres(kept).target_points, points / 1000)


@pytest.fixture(scope="module")
def study(run_tool, tmp_path_factory):
    folder = tmp_path_factory.mktemp("study")
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("TOMO_TEST_DATA", str(folder / "none"))  # the real pairs have their own test
        done = run_tool("calibration_study", "--quick", "-o", folder, "--json")
    assert done.exit_code == 0, (done.stderr, done.exception)
    assert sorted(path.name for path in folder.iterdir()) == [
        "calibration.json", "calibration.md",
    ]  # fmt: skip
    return json.loads((folder / "calibration.json").read_text("utf-8")), folder


def test_the_tiny_rig_s_figures_make_sense_together(study):
    (row,) = study[0]["studies"]["rendered"]
    assert row["footprint"] == pytest.approx(0.32, rel=0.05)
    assert 0 < row["true_ray_miss"] < 0.02
    assert 0 < row["predicted_ray_miss"] < 0.02
    assert row["true_ray_miss_from_metres"] == pytest.approx(row["true_ray_miss"], rel=1e-3)
    # what is not explained by noise of detection is not there: the target is exactly flat
    assert row["rms_px"] == pytest.approx(row["detection_error_px"], rel=0.25)
    assert row["images_used"] <= row["images"] == 18


def test_opencv_s_best_is_the_least_of_its_settings(study):
    from _calibration.claims import best_of_peer

    rows = study[0]["studies"]["peer"]
    assert len(rows) == 6
    misses = [row["true_ray_miss"] for row in rows if row["true_ray_miss"] is not None]
    assert best_of_peer(rows, "arc_complete", 1) == min(misses)
    assert best_of_peer(rows, "arc_complete", 2) is None


def test_the_page_says_what_the_figures_say(study):
    from _benchmark.tables import significant

    result, folder = study
    page = (folder / "calibration.md").read_text("utf-8")
    row = result["studies"]["rendered"][0]
    assert f"| {significant(row['true_ray_miss'])} |" in page
    for claim in result["claims"]:
        assert claim["what"] in page
        assert isinstance(claim["met"], bool)
    wanted = {claim["what"].split(":")[0] for claim in result["claims"]}
    assert {"3 cameras x 6 frames", "the same targets in metres"} <= wanted


def test_pictures_of_other_settings_are_not_taken_for_these(run_tool, study, tmp_path):
    (tmp_path / "arc_complete_1").mkdir()
    (tmp_path / "arc_complete_1" / "made_from.json").write_text("{}")
    done = run_tool("calibration_study", "--quick", "-o", tmp_path / "out", "--pictures", tmp_path)
    assert done.exit_code == 2
    assert "arc_complete_1: found pictures made from other settings" in done.stderr
