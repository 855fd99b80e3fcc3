"""A calibration's figures of its own accuracy against the truth."""

import re
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

from rigs import Rig, Volume, nearest_point, ray_miss
from rigs.calibrate import calibrate
from rigs.calibrate.adjust.bundle import adjust
from rigs.calibrate.adjust.freedom import Freedom
from rigs.calibrate.adjust.observation_arrays import (
    ObservationArrays,
    Scene,
    ordered,
    predicted,
)
from rigs.calibrate.adjust.projection import Lens
from rigs.calibrate.quality.assessment import assessment, findings
from rigs.calibrate.quality.covariance import covariance_of
from rigs.calibrate.quality.quality import with_scene
from rigs.calibrate.quality.ray_miss import camera_accuracies, predicted_squares, views

VOLUME = Volume((10, 10, 10), 5.0, (0.0, 0.0, 800.0))
FINE_VOLUME = Volume((150, 150, 150), 0.33, (0.0, 0.0, 800.0))  # voxels as large as pixels
NOISE = 0.03
PLAIN = {"distortion": "brown4"}  # the true model: no terms are chosen, which takes longest


@pytest.fixture(scope="module")
def case(simulated_rig):
    """Four cameras over 100 degrees, with observations and what they give."""
    truth = simulated_rig("arc", cameras=4, frames=12, seed=1)
    observations = truth.observe(NOISE, seed=1)
    return truth, observations, calibrate(observations, volume=VOLUME)


def pixels_swapped(observations, other, rows):
    """Take the pixels of the same observations from other observations, drop what they lack."""
    size = len(observations.target_points)

    def key(o):
        return (o.camera * len(o.frames) + o.frame) * size + o.point

    place = {k: i for i, k in enumerate(key(other).tolist())}
    found = np.array([place.get(k, -1) for k in key(observations).tolist()])
    uv = np.where((rows & (found >= 0))[:, None], other.uv[found], observations.uv)
    return replace(observations, uv=uv).where(~rows | (found >= 0))


def turned(camera, degrees):
    """Turn a camera on its stand."""
    R = Rotation.from_rotvec(np.deg2rad(degrees) * np.array([0.6, 0.8, 0])).as_matrix()
    return replace(camera, R=R @ camera.R, t=R @ camera.t)


def with_camera(truth, index, camera):
    cameras = list(truth.rig)
    cameras[index] = camera
    return replace(truth, rig=replace(truth.rig, cameras=tuple(cameras)))


# Ray-miss


def test_ray_miss_is_the_distance_from_the_nearest_point(case, judged_volume):
    truth, _, found = case
    points = judged_volume(truth)[::9]
    squares = []
    for point in points:
        rays = [
            other.rays(camera.project(point[None])[0])
            for camera, other in zip(truth.rig, found.rig, strict=True)
        ]
        origins, directions = (np.concatenate(part) for part in zip(*rays, strict=True))
        nearest, _ = nearest_point(origins, directions)
        off = nearest - origins
        across = off - (off * directions).sum(axis=1, keepdims=True) * directions
        squares += (across**2).sum(axis=1).tolist()
    assert ray_miss(truth.rig, found.rig, points) == pytest.approx(np.sqrt(np.mean(squares)))


def test_ray_miss_is_free_of_the_world(case, judged_volume):
    truth, _, found = case
    points = judged_volume(truth)
    R = Rotation.from_rotvec([1, 2, 0.3]).as_matrix()
    moved = found.rig.transformed(R, np.array([1000.0, -50, 3]))
    assert ray_miss(truth.rig, moved, points) == pytest.approx(
        ray_miss(truth.rig, found.rig, points), rel=1e-6
    )
    assert ray_miss(truth.rig, truth.rig, points) < 1e-9


def test_points_of_one_view_do_not_count(case):
    truth, _, found = case
    inside, outside = np.array([[0, 0, 800.0]]), np.array([[0, 0, -800.0]])
    assert np.isnan(ray_miss(truth.rig, found.rig, outside))
    both = ray_miss(truth.rig, found.rig, np.concatenate([inside, outside]))
    assert both == ray_miss(truth.rig, found.rig, inside)
    with pytest.raises(ValueError, match="not in the rig"):
        ray_miss(truth.rig, found.rig[:2], inside)


# Covariance and predictions


@pytest.fixture(scope="module")
def repeated(case):
    """Return a true scene, the joint adjustment repeated with new noise, and its covariance."""
    truth, observations, _ = case
    order = ordered(observations)
    lenses = [Lens(c.camera_matrix, "brown", np.array(c.distortion.coefficients))
              for c in truth.rig]  # fmt: skip
    scene = Scene(
        tuple(lenses),
        np.array([camera.R for camera in truth.rig]),
        np.array([camera.t for camera in truth.rig]),
        truth.target_R,
        truth.target_t,
    )
    free = Freedom(tuple(np.ones(8, bool) for _ in lenses), np.arange(4) > 0)
    exact = ObservationArrays(
        observations.camera[order],
        observations.frame[order],
        truth.points[observations.point[order]],
        observations.uv[order],
    )
    exact = replace(exact, uv=predicted(scene, exact))
    rng = np.random.default_rng(0)
    found = []
    for _ in range(12):
        noisy = replace(exact, uv=exact.uv + NOISE * rng.standard_normal(exact.uv.shape))
        found.append(adjust(scene, noisy, free, tolerance=1e-6).scene)
    noise, covariance = covariance_of(truth.rig, found[-1], noisy, free)
    return SimpleNamespace(
        observations=noisy, scenes=found, free=free, noise=noise, covariance=covariance
    )


def test_predicted_ray_miss_is_the_true_one_on_average(case, repeated, judged_volume):
    truth, _, found = case
    points, free = judged_volume(truth, count=3), repeated.free
    misses = [ray_miss(truth.rig, with_scene(truth.rig, one), points) for one in repeated.scenes]
    seen = views(truth.rig, points)
    squares = predicted_squares(repeated.scenes[-1], free, repeated.covariance, points, seen)
    expected = np.sqrt(squares.sum() / seen.sum())
    assert repeated.noise == pytest.approx(NOISE, rel=0.05)
    assert np.sqrt(np.mean(np.square(misses))) == pytest.approx(expected, rel=0.2)
    deviation = np.sqrt(np.diag(repeated.covariance))[free.places[2][6]]
    steps = [one.lenses[2].matrix[0, 0] for one in repeated.scenes]
    assert np.std(steps) == pytest.approx(deviation, rel=0.5)
    # The whole way, lens terms chosen, other points: within the factor promised
    miss = ray_miss(truth.rig, found.rig, judged_volume(truth))
    assert miss / 1.5 < found.quality.predicted_ray_miss < miss * 1.5


def off(truth, rig, points):
    """Return shift, roll, magnification and direction of each camera's error, ``(cameras, 4)``.

    After the motion of the whole rig that brings the images of points nearest to the true ones.
    """
    middle = points.mean(axis=0)

    def aligned(motion):
        R = Rotation.from_rotvec(motion[:3]).as_matrix()
        return rig.transformed(R, middle - R @ middle + motion[3:])

    def apart(motion):
        pairs = zip(aligned(motion), truth, strict=True)
        return np.concatenate([a.project(points)[0] - b.project(points)[0] for a, b in pairs])

    best = least_squares(lambda m: apart(m).ravel(), np.zeros(6), x_scale=[1e-3] * 3 + [1] * 3)
    rows = []
    for camera, other in zip(aligned(best.x), truth, strict=True):
        u, v = (one.project(points)[0] @ [1, 1j] for one in (other, camera))  # complex numbers
        growth = np.polyfit(u - u.mean(), v, 1)[0]
        sights = [(one.position - middle) / np.linalg.norm(one.position - middle)
                  for one in (camera, other)]  # fmt: skip
        turn = np.rad2deg(np.linalg.norm(np.cross(*sights)))
        shift = abs(np.mean(v - u))
        rows.append([shift, np.rad2deg(np.angle(growth)), abs(growth) - 1, turn])
    return np.array(rows) * [np.sqrt(0.5), 1, 1, np.sqrt(0.5)]


def test_stated_accuracies_are_the_true_ones_on_average(case, repeated, judged_volume):
    truth, *_ = case
    points = judged_volume(truth, count=4)
    errors = [off(truth.rig, with_scene(truth.rig, one), points) for one in repeated.scenes]
    true = np.sqrt(np.square(errors).mean(axis=0))
    seen = views(truth.rig, points)
    found = camera_accuracies(
        repeated.scenes[-1], repeated.free, repeated.covariance, points, seen
    )
    stated = np.array([list(vars(one).values()) for one in found])
    mean = np.sqrt(np.square(true).mean(axis=0)), np.sqrt(np.square(stated).mean(axis=0))
    np.testing.assert_allclose(*mean, rtol=0.25)  # 12 draws of four cameras
    assert (np.abs(np.log(true / stated)) < np.log(2)).all()


def test_accuracies_are_the_same_whichever_camera_is_held(case, repeated, judged_volume):
    truth, *_ = case
    points = judged_volume(truth, count=3)
    seen, scene = views(truth.rig, points), repeated.scenes[0]
    both = []
    for held in (0, 2):
        free = replace(repeated.free, pose=np.arange(4) != held)
        _, covariance = covariance_of(truth.rig, scene, repeated.observations, free)
        found = camera_accuracies(scene, free, covariance, points, seen)
        both.append([list(vars(one).values()) for one in found])
    np.testing.assert_allclose(*both, rtol=0.01)


def test_a_camera_that_sees_too_little_states_no_accuracy(case, repeated, judged_volume):
    truth, *_ = case
    points = judged_volume(truth, count=3)
    seen = views(truth.rig, points)
    seen[1, 5:] = False
    found = camera_accuracies(repeated.scenes[0], repeated.free, repeated.covariance, points, seen)
    assert found[1] is None
    assert found[0] is not None


def test_predictions_by_camera_and_point_add_up(case):
    quality = case[2].quality
    assert quality.points.shape == (len(quality.point_ray_miss), 3)
    assert quality.camera_ray_miss.min() <= quality.predicted_ray_miss
    assert quality.predicted_ray_miss <= quality.camera_ray_miss.max()
    assert np.sqrt(np.mean(quality.point_ray_miss**2)) == pytest.approx(
        quality.predicted_ray_miss, rel=0.05
    )


def test_halves_of_the_frames_differ_as_expected(case):
    quality = case[2].quality
    assert quality.cross_expected / 2 < quality.cross_ray_miss < 2 * quality.cross_expected
    assert 1.5 < quality.cross_expected / quality.predicted_ray_miss < 4


def test_covariance_belongs_to_the_parameters(case):
    *_, found = case
    assert found.covariance.shape == (len(found.parameters),) * 2
    assert np.linalg.eigvalsh(found.covariance / np.sqrt(
        np.outer(np.diag(found.covariance), np.diag(found.covariance)))).min() > 0  # fmt: skip
    held = {name for camera, name in found.parameters if camera == found.gauge}
    assert not held & {"wx", "wy", "wz", "tx", "ty", "tz"}
    assert {"fx", "fy", "cx", "cy"} <= held


def test_errors_that_an_image_shares_raise_the_prediction(case, judged_volume):
    """Each image shifted as a whole: residuals hide most of it, the target's pose takes it up."""
    truth, observations, plain = case
    shift = NOISE * np.random.default_rng(5).standard_normal((4, 12, 2))
    uv = observations.uv + shift[observations.camera, observations.frame]
    found = calibrate(replace(observations, uv=uv), volume=VOLUME, **PLAIN)
    assert found.noise < 1.2 * plain.noise
    assert found.quality.predicted_ray_miss > 2 * plain.quality.predicted_ray_miss
    miss = ray_miss(truth.rig, found.rig, judged_volume(truth))
    assert miss / 2 < found.quality.predicted_ray_miss < miss * 2


def test_coverage_and_depth(case):
    truth, observations, found = case
    quality = found.quality
    for camera in range(4):
        own = observations.camera == camera
        frames, points = observations.frame[own], observations.point[own]
        places = np.einsum("nij,nj->ni", truth.target_R[frames], truth.points[points])
        depth = truth.rig[camera].project(places + truth.target_t[frames])[1]
        # The first camera's axes lie in it within a principal point, and so does the world
        assert np.abs(quality.depth_range[camera] - [depth.min(), depth.max()]).max() < 2
        columns = np.unique((observations.uv[own] * 8 // truth.rig[camera].image_size), axis=0)
        assert quality.image_coverage[camera] == pytest.approx(len(columns) / 64, abs=0.02)


# The responsible camera named


def test_one_image_from_a_camera_that_moved_is_left_out_and_named(case, judged_volume):
    truth, observations, _ = case
    frame = int(np.flatnonzero((observations.counts() > 0).sum(axis=0) >= 3)[0])
    camera = int(np.flatnonzero(observations.counts()[:, frame])[1])
    moved = with_camera(truth, camera, turned(truth.rig[camera], 0.1)).observe(NOISE, seed=1)
    rows = (observations.camera == camera) & (observations.frame == frame)
    found = calibrate(pixels_swapped(observations, moved, rows), **PLAIN)
    assert ray_miss(truth.rig, found.rig, judged_volume(truth)) < 0.003
    name = f"camera cam{camera:02d}, frame {frame:03d}: disagrees with the other cameras"
    assert len(found.findings) == 1
    assert found.findings[0].startswith(name)
    own = (found.observations.camera == camera) & (found.observations.frame == frame)
    assert np.array_equal(~found.used, own)
    assert found.assessment.startswith("good")


def test_a_camera_that_moved_half_way_is_named(simulated_rig):
    truth = simulated_rig("arc", cameras=5, frames=12, seed=3)
    observations = truth.observe(NOISE, seed=1)
    moved = with_camera(truth, 2, turned(truth.rig[2], 0.03)).observe(NOISE, seed=1)
    rows = (observations.camera == 2) & (observations.frame >= 6)
    found = calibrate(pixels_swapped(observations, moved, rows), **PLAIN)
    assert found.assessment.startswith("doubtful")
    assert any(line.startswith("camera cam02: ") for line in found.findings)
    assert not any(f"camera cam0{other}: " in line for other in (0, 1, 3, 4)
                   for line in found.findings)  # fmt: skip


def test_a_camera_that_moved_and_shares_most_frames_with_one_other_is_named(simulated_rig):
    """When two disagree the good one may be left out; it must not be named as responsible."""
    truth = simulated_rig("arc", cameras=3, frames=24)
    observations = truth.observe(NOISE, seed=1)
    moved = (observations.camera == 2) & (observations.frame >= 14)
    shifted = replace(observations, uv=observations.uv + moved[:, None] * [2.0, 1.0])
    found = calibrate(shifted, **PLAIN)
    assert found.assessment.startswith("doubtful")
    assert any(line.startswith("camera cam02: in 4 of its 14 images") for line in found.findings)
    assert not any(line.startswith(("camera cam00", "camera cam01")) for line in found.findings)


def test_a_camera_that_is_not_synchronised_is_named(simulated_rig):
    truth = simulated_rig("arc", cameras=5, frames=12, seed=3)
    observations = truth.observe(NOISE, seed=1)
    late = replace(
        truth, target_R=np.roll(truth.target_R, 1, 0), target_t=np.roll(truth.target_t, 1, 0)
    ).observe(NOISE, seed=1)
    rows = observations.camera != 3
    others, own = observations.where(rows), late.where(late.camera == 3)
    joined = replace(
        observations,
        **{
            name: np.concatenate([getattr(others, name), getattr(own, name)])
            for name in ("camera", "frame", "point", "uv")
        },
    )
    with pytest.raises(ValueError, match=r"camera cam03: sees the target .* not synchronised"):
        calibrate(joined, **PLAIN)


def test_a_given_lens_that_is_wrong_is_named(case):
    truth, observations, _ = case
    matrix = truth.rig[1].camera_matrix.copy()
    matrix[[0, 1], [0, 1]] *= 1.01
    wrong = with_camera(truth, 1, replace(truth.rig[1], camera_matrix=matrix)).rig
    found = calibrate(observations, intrinsics=wrong, volume=FINE_VOLUME)
    assert found.assessment.startswith("doubtful")
    assert any(line.startswith("camera cam01: its given lens") for line in found.findings)
    assert int(np.argmax(found.quality.lens_misfit)) == 1


def test_errors_of_less_than_a_tenth_of_a_voxel_are_no_finding(case):
    """A displacement of a fiftieth of a pixel, however significant: 10 standard deviations."""
    truth, _, _ = case
    clean = truth.observe(0.005, seed=1)
    shift = np.random.default_rng(0).normal(size=(4, 12, 2)) * 0.02
    moved = replace(clean, uv=clean.uv + shift[clean.camera, clean.frame])
    found = calibrate(moved, volume=FINE_VOLUME, **PLAIN)
    assert np.nanmax(found.quality.contradiction) > 4
    assert found.assessment.startswith("good: ")
    assert "of a voxel" in found.assessment
    assert found.findings == ()
    much = replace(clean, uv=clean.uv + 10 * shift[clean.camera, clean.frame])
    assert calibrate(much, volume=FINE_VOLUME, **PLAIN).findings


def test_points_left_out_are_a_warning_only_where_the_rest_does_not_suffice(case):
    _, observations, _ = case
    random = np.random.default_rng(0)
    wrong = (observations.camera == 2) & (random.random(len(observations)) < 0.15)
    uv = observations.uv + 10 * wrong[:, None] * random.choice([-1, 1], (len(observations), 2))
    found = calibrate(replace(observations, uv=uv), volume=VOLUME, **PLAIN)
    fine = findings(found.quality, found.observations, found.used, found.noise, voxel=0.01)
    in_fine_voxels = assessment(found.quality, *fine, "mm", voxel=0.01)
    for said, word in ((found.assessment, "good"), (in_fine_voxels, "doubtful")):
        assert said.startswith(word)
        assert "camera cam02: " in said
        assert "points left out" in said


def test_gross_outliers_are_left_out_and_counted(case, judged_volume):
    truth, observations, found = case
    rng = np.random.default_rng(0)
    wrong = rng.uniform(size=len(observations)) < 0.05
    uv = observations.uv + wrong[:, None] * rng.choice([-1, 1], (len(wrong), 2)) * rng.uniform(
        3, 20, (len(wrong), 2)
    )
    robust = calibrate(replace(observations, uv=uv), volume=VOLUME, **PLAIN)
    assert np.array_equal(~robust.used, wrong)
    assert robust.rig.calibration["points_left_out"] == wrong.sum()
    miss = ray_miss(truth.rig, robust.rig, judged_volume(truth))
    assert miss < 1.5 * ray_miss(truth.rig, found.rig, judged_volume(truth))
    kept = calibrate(replace(observations, uv=uv), volume=VOLUME, cull=False, **PLAIN)
    assert kept.used.all()
    assert ray_miss(truth.rig, kept.rig, judged_volume(truth)) > 5 * miss


def test_images_taken_the_wrong_way_round_are_left_out(case, judged_volume):
    truth, observations, _ = case
    frame = int(np.flatnonzero((observations.counts() > 0).sum(axis=0) >= 3)[0])
    camera = int(np.flatnonzero(observations.counts()[:, frame])[0])
    turned_round = (observations.camera == camera) & (observations.frame == frame)
    point = np.where(turned_round, 29 - observations.point, observations.point)
    found = calibrate(replace(observations, point=point), **PLAIN)
    assert np.array_equal(~found.used, turned_round)
    assert ray_miss(truth.rig, found.rig, judged_volume(truth)) < 0.003


def test_a_target_that_covers_little_is_reported(case):
    _, observations, _ = case
    middle = (np.abs(observations.uv - [320, 240]) < 110).all(axis=1)
    wide = Volume((9, 9, 9), 12, (0, 0, 800))
    found = calibrate(observations.where(middle), volume=wide, **PLAIN)
    assert "of where the image shows the volume: its lens is extrapolated" in found.assessment
    assert (found.quality.image_coverage < 0.5).all()
    assert found.assessment.startswith("doubtful")


def test_a_camera_that_does_not_see_the_volume_is_named(case):
    truth, observations, _ = case
    aside = Volume((4, 4, 4), 5.0, (140.0, 0.0, 800.0))
    found = calibrate(observations, intrinsics=truth.rig, volume=aside)
    blind = np.isnan(found.quality.camera_ray_miss)
    assert blind.any()
    for name, is_blind in zip(truth.rig.names, blind, strict=True):
        line = f"camera {name}: sees no part of the volume that another camera sees"
        assert any(finding.startswith(line) for finding in found.findings) == is_blind
    assert found.assessment.startswith("doubtful")


def test_a_volume_nobody_sees_is_refused(case):
    truth, observations, _ = case
    behind = Volume((3, 3, 3), 1.0, (0.0, 0.0, -500.0))
    with pytest.raises(ValueError, match="volume: found no point of it") as refused:
        calibrate(observations, intrinsics=truth.rig, volume=behind)
    *_, depth = re.search(r"near \((.*)\)", str(refused.value))[1].split(",")
    assert float(depth) == pytest.approx(800, abs=100)  # where the target was


def test_the_volume_travels_with_the_rig(case):
    *_, found = case
    assert found.rig.volume == VOLUME
    assert isinstance(found.rig, Rig)
    corners = VOLUME.corners()
    assert (found.quality.points >= corners.min(axis=0)).all()
    assert (found.quality.points <= corners.max(axis=0)).all()
