"""Cameras out of step: offsets in time from films of a target that moves, with their errors."""

import re
from dataclasses import replace

import numpy as np
import pytest

from rigs import Rig
from rigs.calibrate import calibrate, frame_times


def calibrated(seen, rig=None, **options):
    """Return the calibration of a film, with the true lenses of ``rig`` where it is given."""
    return calibrate(seen, times=frame_times(seen.frames), intrinsics=rig, **options)


@pytest.mark.parametrize(
    ("offsets", "seed"),
    [((0, -0.07, 0.31), 13), ((0, 0, 6.4), 2), ((-2.7, 0, 0, 0), 3)],
)
def test_offsets_come_back_within_their_errors(moving_target, offsets, seed):
    rig, seen = moving_target(offsets, seed=seed)
    found = calibrated(seen, rig).synchrony
    true = np.array(offsets) - offsets[found.reference]
    off = np.abs(found.offset - true)
    assert (off < np.maximum(0.05, found.error)).all()
    assert (off <= 4 * found.error + 1e-9).all()  # and the errors say how far they are off
    assert (found.error < 0.02).all()
    np.testing.assert_array_equal(found.is_out, np.abs(true) > 0.02)


def test_lenses_and_offsets_are_found_together(moving_target, judged_volume):
    from rigs.check.lines_of_sight import ray_miss

    rig, seen = moving_target((0, 0.5, 0), seed=4)
    apart = calibrate(seen, distortion="brown4")
    found = calibrated(seen)
    assert found.synchrony.offset[1] == pytest.approx(0.5, abs=0.01)
    points = judged_volume(None, half=15.0, count=3)
    assert ray_miss(rig, found.rig, points) < 0.05
    assert ray_miss(rig, apart.rig, points) > 5 * ray_miss(rig, found.rig, points)


def test_errors_are_those_of_many_films(moving_target):
    """The offsets' spread over films of other noise is what each film states."""
    off, error = [], []
    for seed in range(5):
        rig, seen = moving_target((0, 0.3), noise=0.3, noise_seed=seed)
        found = calibrated(seen, rig).synchrony
        off.append(found.offset[1] - 0.3)
        error.append(found.error[1])
    ratio = np.sqrt(np.mean((np.array(off) / error) ** 2))
    assert 0.5 < ratio < 2.0


def test_cameras_in_step_stay_as_they_are(moving_target):
    rig, seen = moving_target((0, 0, 0), seed=5)
    found, untimed = calibrated(seen, rig), calibrate(seen, intrinsics=rig)
    assert not found.synchrony.is_out.any()
    assert np.abs(found.synchrony.offset).max() < 0.02
    assert found.rig == replace(untimed.rig, calibration=found.rig.calibration)
    assert "out of step" not in found.assessment


def test_a_bad_lens_is_not_taken_for_a_camera_out_of_step(moving_target):
    rig, seen = moving_target((0, 0, 0), seed=6)
    K = rig[1].camera_matrix * [[1.03, 1, 1], [1, 1.03, 1], [1, 1, 1]]
    wrong = replace(rig, cameras=(rig[0], replace(rig[1], camera_matrix=K), rig[2]))
    found = calibrated(seen, wrong)
    assert not found.synchrony.is_out.any()
    assert np.abs(found.synchrony.offset).max() < 0.05
    assert "camera cam01: its given lens does not fit" in found.assessment
    assert "it is in step, within" in found.assessment
    assert "out of step" not in found.assessment


def test_the_message_says_how_far_which_way_and_what_to_do(moving_target):
    rig, seen = moving_target((0, 0, -3.4), seed=4)
    found = calibrated(seen, rig)
    (line,) = [line for line in found.findings if "out of step" in line]
    assert re.match(r"camera cam02: out of step: its images were taken 3\.(39|4)\d* frames", line)
    assert "before those of the same number of cam00" in line
    assert "pair its image n+3 with image n of the others in scan.yaml" in line
    assert "its lens is not at fault" in line
    assert found.assessment.startswith("good")
    figures = found.rig.calibration["cameras"]["cam02"]
    assert figures["time_offset_frames"] == pytest.approx(-3.4, abs=0.02)
    assert 0 < figures["time_offset_error_frames"] < 0.02
    assert figures["out_of_step"]


def test_images_of_other_moments_and_missing_ones_do_not_bend_the_way(moving_target):
    """One image of twelve is displaced whole, some points are wrong, and a tenth is missing."""
    rig, seen = moving_target((0, 0.4, 0), frames=24, seed=3)
    rng = np.random.default_rng(1)
    uv = seen.uv.copy()
    for frame in (7, 15):
        uv[(seen.camera == 1) & (seen.frame == frame)] += rng.normal(0, 20, 2)
    uv[rng.choice(len(uv), 36, replace=False)] += rng.normal(0, 15, (36, 2))
    kept = rng.uniform(size=(3, 24)) > 0.1
    wrong = replace(seen, uv=uv).where(kept[seen.camera, seen.frame])
    found = calibrated(wrong, rig).synchrony
    assert found.offset[1] == pytest.approx(0.4, abs=0.02)
    assert found.is_out.tolist() == [False, True, False]


def test_a_camera_that_moved_is_not_out_of_step(moving_target):
    rig, seen = moving_target((0, 0, 0), frames=24, seed=12)
    uv = seen.uv + np.where((seen.camera == 1) & (seen.frame > 15), 3.0, 0.0)[:, None]
    found = calibrated(replace(seen, uv=uv), rig)
    assert not found.synchrony.is_out.any()
    assert "moved" in found.assessment
    assert "synchronised" not in found.assessment.split("\n")[1]


def test_pictures_of_a_film_may_be_left_out(moving_target):
    rig, seen = moving_target((0, 1.5, 0), seed=3, step=3)
    found = calibrated(seen, rig).synchrony
    assert abs(found.offset[1] - 1.5) < max(0.05, found.error[1])


def test_images_of_a_target_at_rest_show_no_moments(simulated_rig):
    simulated = simulated_rig(frames=20)
    seen = simulated.observe(0.1, 1)
    found = calibrate(seen, times=frame_times(seen.frames), intrinsics=simulated.rig)
    assert found.synchrony is None
    assert "time_offset_frames" not in found.rig.calibration["cameras"]["cam00"]


def test_frames_without_a_moment_take_part(moving_target):
    """Images of one camera's lens alone belong to no moment of the film."""
    rig, seen = moving_target((0, 0.5, 0), seed=3)
    times = frame_times(seen.frames)
    names = tuple(f"lens {name}" if k >= 17 else name for k, name in enumerate(seen.frames))
    apart = replace(seen.where((seen.frame < 17) | (seen.camera == 0)), frames=names)
    kept = {name: times[name] for name in seen.frames[:17]}
    found = calibrate(apart, times=kept, intrinsics=rig)
    assert found.synchrony.offset[1] == pytest.approx(0.5, abs=0.02)
    lens = found.observations.frame >= 17
    assert found.used[lens].mean() > 0.9


def test_numbers_in_names_are_moments():
    assert frame_times(["a_8", "a_10"]) == {"a_8": 8.0, "a_10": 10.0}
    assert frame_times(["a_8", "b_9"]) is None
    assert frame_times(["a_8", "a"]) is None
    assert frame_times(["a_8", "a_08"]) is None
    assert frame_times([]) is None


def test_one_camera_has_none_to_be_in_step_with(moving_target, one_camera):
    rig, seen = moving_target((0, 0.5), seed=9)
    found = calibrated(one_camera(seen), Rig(rig.cameras[:1]))
    assert found.synchrony is None
