"""The study of calibration: its measure of truth, and the whole of it on a tiny rig."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from studies.calibration import study
from studies.common.study import Request

from rigs import Rig, Volume, arc
from rigs.calibrate import Observations

VOLUME = Volume((10, 10, 10), 4.0)
RIG = arc(3, 60.0, 500.0, image_size=(300, 300), footprint=0.3, volume=VOLUME)


def test_a_rig_does_not_miss_itself_wherever_its_world_is():
    assert study.true_ray_miss(RIG, RIG, VOLUME) < 1e-10
    R = Rotation.from_rotvec([0.3, -1.2, 0.7]).as_matrix()
    assert study.true_ray_miss(RIG, RIG.transformed(R, [40.0, -3.0, 900.0]), VOLUME) < 1e-9


def test_a_camera_that_looks_beside_misses_by_what_geometry_says():
    """A camera lifted by h off the others' plane: least squares leaves h times sqrt(2) / 3.

    Three rays whose heights are 0, 0 and h have their best common point at h / 3.
    """
    lifted = replace(RIG[1], t=RIG[1].t + RIG[1].R @ [0.0, -0.06, 0.0])
    rig = Rig((RIG[0], lifted, RIG[2]))
    expected = 0.06 * np.sqrt(2) / 3
    assert study.true_ray_miss(RIG, rig, VOLUME) == pytest.approx(expected, rel=0.01)


def test_only_images_with_every_point_are_complete():
    points = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0]])
    camera, frame, point = np.array([[0, 0, 0], [0, 0, 1], [0, 0, 2], [1, 0, 0], [1, 0, 2]]).T
    observations = Observations(
        points, ("a", "b"), ((9, 9),) * 2, ("f",), camera, frame, point, np.ones((5, 2))
    )
    kept = study.of_complete_targets(observations)
    assert kept.counts().tolist() == [[3], [0]]
    assert kept.cameras == ("a", "b")
    np.testing.assert_array_equal(study.in_metres(kept).target_points, points / 1000)


@pytest.fixture(scope="module")
def tables():
    return study.run(Request("tiny"))


def test_the_tiny_rig_s_figures_make_sense_together(tables):
    (row,) = tables["rendered"]
    assert row["footprint"] == pytest.approx(0.32, rel=0.05)
    assert 0 < row["true_ray_miss"] < 0.02
    assert 0 < row["predicted_ray_miss"] < 0.02
    # what is not explained by noise of detection is not there: the target is exactly flat
    assert row["rms_px"] == pytest.approx(row["detection_error_px"], rel=0.25)
    assert row["images_used"] <= row["images"] == 18


def test_opencv_is_tried_at_six_settings_and_time_is_taken(tables):
    assert len(tables["peer"]) == 6
    assert any(row["true_ray_miss"] is not None for row in tables["peer"])
    (row,) = tables["timing"]
    assert (row["cameras"], row["frames"]) == (3, 6)
    assert 0 < row["true_ray_miss"] < 0.05
