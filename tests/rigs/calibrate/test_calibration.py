"""Calibration of simulated rigs: accuracy, gauge, units, rings, partial boards, bad input."""

from dataclasses import replace

import numpy as np
import pytest

from rigs import Distortion, RayTable, Rig, ray_miss
from rigs.calibrate import Observations, calibrate
from rigs.calibrate.adjust.lens_choice import TERMS
from rigs.calibrate.observations import without_repeats

NOISE = 0.03
PLAIN = {"distortion": "brown4"}  # the true model: no terms are chosen, which takes longest


@pytest.fixture(scope="module")
def arc_case(simulated_rig):
    """Four cameras over 100 degrees, with observations and what they give."""
    truth = simulated_rig("arc", cameras=4, frames=12, seed=1)
    observations = truth.observe(NOISE, seed=1)
    return truth, observations, calibrate(observations)


@pytest.fixture(scope="module")
def with_lenses(arc_case):
    """The same where the lenses are given: only poses are looked for, in a third of the time."""
    truth, observations, _ = arc_case
    return truth, observations, calibrate(observations, intrinsics=truth.rig)


def test_an_arc_is_found_within_a_hundredth_of_a_pixel(arc_case, judged_volume):
    truth, observations, found = arc_case
    assert ray_miss(truth.rig, found.rig, judged_volume(truth)) < 0.003
    assert found.used.all()
    assert found.noise == pytest.approx(NOISE, rel=0.05)
    assert found.assessment.startswith("good")
    assert found.findings == ()
    assert found.rig.names == observations.cameras
    # Figures that do not depend on the first camera's axes
    places = np.array([camera.position for camera in found.rig])
    true = np.array([camera.position for camera in truth.rig])
    apart, expected = (np.linalg.norm(p[:, None] - p[None, :], axis=2) for p in (places, true))
    assert np.abs(apart - expected).max() < 1.0  # of 800


def test_residuals_are_measured_less_projected_by_the_rig(arc_case):
    _, observations, found = arc_case
    for row in (0, 333, len(observations) - 1):
        frame = observations.frame[row]
        point = observations.target_points[observations.point[row]]
        place = found.target_R[frame] @ point + found.target_t[frame]
        uv, _, _ = found.rig[int(observations.camera[row])].project(place[None])
        assert np.abs(observations.uv[row] - uv[0] - found.residuals[row]).max() < 1e-9


def test_the_same_input_gives_the_same_rig(arc_case):
    _, observations, found = arc_case
    assert calibrate(observations).rig == found.rig


def test_sightings_in_any_order_give_the_same_rig(arc_case):
    _, observations, found = arc_case
    order = np.random.default_rng(0).permutation(len(observations))
    shuffled = calibrate(observations.where(order))
    assert np.abs(shuffled.residuals - found.residuals[order]).max() < 1e-5


def test_millimetres_and_metres_give_the_same_rig(arc_case):
    _, observations, found = arc_case
    metres = calibrate(
        replace(observations, target_points=observations.target_points / 1000), length_unit="m"
    )
    assert metres.rig.length_unit == "m"
    assert metres.terms == found.terms
    for mm, m in zip(found.rig, metres.rig, strict=True):
        assert np.abs(mm.camera_matrix - m.camera_matrix).max() < 1e-4
        assert np.abs(mm.t - m.t * 1000).max() < 1e-4
    quality, other = found.quality, metres.quality
    assert other.predicted_ray_miss * 1000 == pytest.approx(quality.predicted_ray_miss, rel=1e-3)
    assert other.cross_ray_miss * 1000 == pytest.approx(quality.cross_ray_miss, rel=1e-3)


def test_the_world_is_the_first_camera_unless_said_otherwise(arc_case):
    _, _, found = arc_case
    assert np.abs(found.rig[0].R - np.eye(3)).max() < 1e-12
    assert np.abs(found.rig[0].t).max() < 1e-9
    assert "cam00" in found.rig.world_frame


def test_given_lenses_are_kept(arc_case, with_lenses, judged_volume):
    truth, _, found = arc_case
    fixed = with_lenses[2]
    for true, camera in zip(truth.rig, fixed.rig, strict=True):
        assert np.array_equal(true.camera_matrix, camera.camera_matrix)
        assert true.distortion == camera.distortion
    assert fixed.quality.predicted_ray_miss < found.quality.predicted_ray_miss
    assert ray_miss(truth.rig, fixed.rig, judged_volume(truth)) < 0.003
    assert fixed.terms == ("given",) * 4
    assert (fixed.quality.lens_misfit < 2).all()


def test_lens_terms_are_freed_when_they_pay(simulated_rig):
    truth = simulated_rig("arc", cameras=2, frames=14, seed=5)
    straight = tuple(replace(camera, distortion=Distortion()) for camera in truth.rig)
    plain = calibrate(replace(truth, rig=Rig(straight)).observe(NOISE, seed=1))
    bent = calibrate(truth.observe(NOISE, seed=1))
    size = {name: sum(terms.free) for name, terms in TERMS.items()}
    assert all(size[name] >= 2 for name in bent.terms)
    assert sum(size[name] for name in plain.terms) < sum(size[name] for name in bent.terms)


def test_terms_that_one_camera_cannot_tell_are_freed_together(simulated_rig, judged_volume):
    """All targets parallel: no camera knows its lens by itself, but together they do."""
    truth = simulated_rig("arc", cameras=4, frames=10, seed=2)
    R = np.tile(truth.rig[1].R.T, (10, 1, 1))
    t = np.array([0, 0, 800]) + np.random.default_rng(1).uniform(-40, 40, (10, 3))
    parallel = replace(truth, target_R=R, target_t=t - R @ truth.points.mean(axis=0))
    found = calibrate(parallel.observe(NOISE, seed=1, facing=0.2))
    assert set(found.terms) <= {"brown4", "brown5"}
    miss = ray_miss(truth.rig, found.rig, judged_volume(truth))
    assert miss < 0.003
    assert miss / 1.5 < found.quality.predicted_ray_miss < miss * 1.5


def test_data_without_noise_give_the_rig_to_rounding(simulated_rig, judged_volume):
    truth = simulated_rig("arc", cameras=3, frames=8, seed=2)
    found = calibrate(truth.observe(0.0, seed=1, facing=0.3))
    assert ray_miss(truth.rig, found.rig, judged_volume(truth)) < 1e-6
    assert found.used.all()
    assert found.assessment.startswith("good")


def test_a_wide_fisheye_on_request(simulated_rig, judged_volume):
    truth = simulated_rig("arc", cameras=3, frames=14, seed=6, spread=60)
    lens = Distortion("fisheye", (-0.02, 0.01, 0.0, 0.0))
    wide = []
    for camera in truth.rig:
        K = camera.camera_matrix.copy()
        K[0, 0], K[1, 1] = 420, 421
        wide.append(replace(camera, camera_matrix=K, distortion=lens))
    big = replace(truth, rig=Rig(tuple(wide)), points=truth.points * 3)
    found = calibrate(big.observe(0.05, seed=2), distortion="fisheye")
    assert found.rig[0].distortion.model == "fisheye"
    assert ray_miss(big.rig, found.rig, judged_volume(truth)) < 0.05  # a pixel is 1.9 there


def test_partial_boards_and_points_of_no_pose_are_used(simulated_rig, judged_volume):
    truth = simulated_rig("arc", cameras=4, frames=16, seed=4, spread=70)
    observations = truth.observe(NOISE, seed=3)
    counts = observations.counts()
    partial = (counts > 0) & (counts < len(truth.points))
    assert partial.sum() > 10
    # Images of fewer points than a pose needs count where another camera saw the target whole
    few = (observations.camera == 1) & (observations.frame % 3 == 0) & (observations.point > 3)
    found = calibrate(observations.where(~few), **PLAIN)
    assert found.used.all()
    assert ray_miss(truth.rig, found.rig, judged_volume(truth)) < 0.006


def test_frames_that_show_too_little_are_reported_and_not_used(arc_case):
    _, observations, _ = arc_case
    little = (observations.frame == 3) & (observations.point > 4)
    found = calibrate(observations.where(~little), **PLAIN)
    frame = found.observations.frame == 3
    assert frame.any()
    assert np.isnan(found.target_t[3]).all()
    assert np.isnan(found.residuals[frame]).all()
    assert np.array_equal(~found.used, frame)
    assert [line.split(":")[0] for line in found.findings] == ["frames 003"]
    assert found.assessment.startswith("good")


def test_one_camera_gives_its_lens(arc_case, one_camera):
    truth, observations, _ = arc_case
    found = calibrate(one_camera(observations, 2))
    assert len(found.rig) == 1
    focal, true = found.rig[0].camera_matrix[0, 0], truth.rig[2].camera_matrix[0, 0]
    assert focal == pytest.approx(true, rel=0.003)
    assert np.isnan(found.quality.predicted_ray_miss)
    assert "one camera" in found.assessment


def test_the_summary_is_plain_and_the_rig_can_be_saved(arc_case, tmp_path):
    from rigs import load_rig, save_rig

    *_, found = arc_case
    save_rig(found.rig, tmp_path / "rig.yaml")
    again = load_rig(tmp_path / "rig.yaml")
    assert again.calibration == found.rig.calibration
    assert again.calibration["cameras"]["cam02"]["points_left_out"] == 0
    assert again.calibration["ray_miss_predicted"] < 0.003


def test_the_world_may_be_that_of_a_frame(with_lenses, judged_volume):
    truth, observations, found = with_lenses
    frame = calibrate(observations, intrinsics=truth.rig, world="004")
    assert np.abs(frame.target_R[4] - np.eye(3)).max() < 1e-12
    assert np.abs(frame.target_t[4]).max() < 1e-9
    assert "004" in frame.rig.world_frame
    assert np.abs(frame.residuals - found.residuals).max() < 1e-6
    assert ray_miss(found.rig, frame.rig, judged_volume(truth)) < 1e-7


def test_given_positions_set_the_scale(with_lenses):
    truth, observations, found = with_lenses
    given = {camera.name: 2 * camera.position + 100 for camera in truth.rig}
    scaled = calibrate(observations, intrinsics=truth.rig, world=given, rescale=True)
    for camera in scaled.rig:
        assert np.linalg.norm(given[camera.name] - camera.position) < 3.0
    assert np.abs(scaled.residuals - found.residuals).max() < 1e-6
    side = np.ptp(scaled.observations.target_points, axis=0)[0]
    assert side == pytest.approx(2 * np.ptp(observations.target_points, axis=0)[0], rel=0.002)


# Bad input


def test_cameras_without_shared_views_are_named(arc_case):
    truth, observations, _ = arc_case
    late = observations.frame >= 6
    apart = observations.where(np.where(observations.camera >= 2, late, ~late))
    with pytest.raises(ValueError, match=r"cameras cam0[02], cam0[13]: found no frame"):
        calibrate(apart, intrinsics=truth.rig)


def test_too_few_views_are_named(arc_case):
    _, observations, _ = arc_case
    first = np.flatnonzero(observations.camera == 1)[0]
    keep = (observations.camera != 1) | (observations.frame == observations.frame[first])
    few = observations.where(keep)
    with pytest.raises(ValueError, match="camera cam01: found 1 images"):
        calibrate(few)
    with pytest.raises(ValueError, match="observations: found none"):
        calibrate(observations.where(np.zeros(len(observations), bool)))


def test_parallel_targets_do_not_give_a_focal_length(simulated_rig):
    truth = simulated_rig("arc", cameras=1, frames=12, seed=0)
    rng = np.random.default_rng(1)
    middle = truth.points.mean(axis=0)
    t = np.c_[rng.uniform(-25, 25, (12, 2)), rng.uniform(720, 880, 12)] - middle
    flat = replace(truth, target_R=np.tile(np.eye(3), (12, 1, 1)), target_t=t)
    with pytest.raises(ValueError, match=r"camera cam00: .*(focal length|not determined).*tilted"):
        calibrate(flat.observe(0.05, seed=0))


def test_an_ambiguous_target_is_refused_for_a_rig_but_not_for_a_lens(arc_case, one_camera):
    class Symmetric:
        ambiguity = "it looks the same turned by half a turn"

    _, observations, _ = arc_case
    with pytest.raises(ValueError, match=r"target: its pose is ambiguous .*half a turn"):
        calibrate(observations, target=Symmetric())
    assert len(calibrate(one_camera(observations, 2), target=Symmetric()).rig) == 1


def test_a_mirrored_target_is_refused(arc_case):
    _, observations, _ = arc_case
    mirrored = replace(observations, target_points=observations.target_points * [-1.0, 1, 1])
    with pytest.raises(ValueError, match="camera cam00: sees the target from behind"):
        calibrate(mirrored)


def test_names_and_models_that_do_not_fit(arc_case):
    truth, observations, _ = arc_case
    with pytest.raises(ValueError, match="distortion: found 'brown', expected one of auto, none"):
        calibrate(observations, distortion="brown")
    with pytest.raises(ValueError, match="intrinsics: camera cam03: not in the rig"):
        calibrate(observations, intrinsics=truth.rig[:3])
    small = Rig(tuple(replace(camera, image_size=(64, 48)) for camera in truth.rig))
    with pytest.raises(
        ValueError, match=r"intrinsics: camera cam00: image_size: found \(64, 48\)"
    ):
        calibrate(observations, intrinsics=small)
    table = RayTable("cam00", (0, 0, 0), np.ones((480, 640, 3)))
    with pytest.raises(ValueError, match="intrinsics: camera cam00: found a ray table"):
        calibrate(observations, intrinsics=Rig((table, *truth.rig.cameras[1:])))
    with pytest.raises(ValueError, match="rescale"):
        calibrate(observations, rescale=True)
    for unknown in ("nothing", dict.fromkeys(["cam00", "cam01", "nothing"], (0, 0, 0))):
        with pytest.raises(ValueError, match="world: found 'nothing', expected the name"):
            calibrate(observations, world=unknown)
    tilted = observations.target_points + [0, 0, 1.0] * (np.arange(30) == 3)[:, None]
    with pytest.raises(ValueError, match="flat target"):
        calibrate(replace(observations, target_points=tilted))


def test_a_camera_of_given_lens_that_sees_too_little_of_the_target_is_named(arc_case):
    truth, observations, _ = arc_case
    little = (observations.camera != 2) | (observations.point < 4)
    with pytest.raises(ValueError, match="camera cam02: found no image with 6 or more target"):
        calibrate(observations.where(little), intrinsics=truth.rig)


def test_repeated_images_count_once_and_are_reported(arc_case):
    _, observations, found = arc_case
    again = observations.frame == 4
    last = len(observations.frames)
    doubled = Observations(
        observations.target_points,
        observations.cameras,
        observations.image_sizes,
        (*observations.frames, "copy"),
        np.r_[observations.camera, observations.camera[again]],
        np.r_[observations.frame, np.full(again.sum(), last)],
        np.r_[observations.point, observations.point[again]],
        np.r_[observations.uv, observations.uv[again]],
    )
    keep, frozen, repeats = without_repeats(doubled)
    assert keep.sum() == len(observations)
    assert keep[: len(observations)].all()
    assert frozen == ()
    assert repeats == ("frame copy: the same as 004 in every camera, counted once",)
    noisy = (doubled.frame == last) & (doubled.camera != 2)
    moved = replace(doubled, uv=doubled.uv + 0.1 * noisy[:, None])
    keep, frozen, repeats = without_repeats(moved)
    assert np.array_equal(~keep, (doubled.frame == last) & (doubled.camera == 2))
    assert repeats == ()
    assert frozen[0].startswith("camera cam02: frame copy is the same image as 004 while other")
    assert (found.findings, len(found.used)) == ((), len(observations))
