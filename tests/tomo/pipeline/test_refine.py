"""What is said of cameras that were refined."""

import json
from dataclasses import replace

import numpy as np
import pytest

from rigs import Accuracy
from rigs.geometry.rotation import matrix_of_vector
from tomo.inference.left_out import LeftOut
from tomo.pipeline.refine import Refinement, priors_of

BETTER = LeftOut(np.array([0.9]), np.array([0.1]))


def test_the_report_says_where_a_camera_went(observed):
    one, _ = observed
    rig, turn, way = one.rig, np.array([0.01, -0.02, 0.03]), np.array([1.0, -2.0, 0.5])
    given = rig[2]
    matrix = np.array(given.camera_matrix)
    matrix[:2, :2] *= 1.02
    R = matrix_of_vector(turn) @ given.R
    there = given.with_pose(matrix, R, -R @ (given.position + given.R.T @ way)).shifted(0.5, -1)
    moved = replace(rig, cameras=(*rig[:2], there, *rig[3:]))
    found = Refinement(
        rig, moved, ("cam02",), True, one.grid, {"cam02": 0.7}, {"cam02": 0.9}, BETTER
    )
    report = json.loads(json.dumps(found.report()))
    assert report["accepted"]
    assert report["held_out_error_after"] < report["held_out_error_before"]
    (said,) = report["cameras"].values()
    np.testing.assert_allclose(said["position_right_down_forward"], way)
    np.testing.assert_allclose(said["turn_degrees"], np.degrees(turn))
    np.testing.assert_allclose(said["shift_pixels"], [0.5, -1], atol=1e-9)
    assert said["focal_length_ratio"] == pytest.approx(1.02)
    assert (said["prior_pixels"], said["gain"]) == (0.7, 0.9)
    assert "cam02 moves farthest" in found.sentence(frames=1)


def test_a_shift_moves_all_pixels_alike(observed):
    one, _ = observed
    there = replace(one.rig, cameras=(one.rig[0].shifted(3, 4), *one.rig[1:]))
    found = Refinement(one.rig, there, ("cam00",), True, one.grid, {"cam00": 1.0}, {}, BETTER)
    assert found.report()["cameras"]["cam00"]["moved_pixels"] == pytest.approx(5)


def test_cameras_that_stay_are_said_to(observed):
    one, _ = observed
    worse = LeftOut(BETTER.after, BETTER.before)
    for left_out, words in ((worse, "do not improve"), (None, "too little light")):
        found = Refinement(one.rig, one.rig, ("cam00",), True, one.grid, {}, {}, left_out)
        assert not found.accepted
        assert words in found.sentence(frames=1)


def test_priors_come_from_what_the_rig_states(observed):
    one, _ = observed
    nominal = replace(one.rig[0], status="nominal")
    known = one.rig[1].with_accuracy(Accuracy(3.0, 0.0, 0.0, 0.0))
    seen = replace(one, rig=replace(one.rig, cameras=(nominal, known, *one.rig[2:])))
    names = ["cam00", "cam01", "cam02"]
    found = priors_of(names, seen)
    assert found["cam00"] > 2
    assert found["cam01"] == pytest.approx(np.hypot(0.5, np.sqrt(3.0)))
    assert found["cam02"] == 0.5
