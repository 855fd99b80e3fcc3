"""Calibration through windows and into water: accuracy, windows adjusted, panes ignored."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from rigs import Rig, load_rig, ray_miss, save_rig
from rigs.calibrate import calibrate
from rigs.calibrate.refraction import WindowPrior
from rigs.scene import Glass, Scene, Window

NOISE = 0.1


def windows_before(rig, distance, size, angle=25.0, **other):
    """Return a window of 10 mm before each camera, tilted to its axis."""
    solids = []
    for number, camera in enumerate(rig):
        axis, side = camera.R[2], camera.R[number % 2]
        normal = -Rotation.from_rotvec(np.radians(angle) * side).as_matrix() @ axis
        place = camera.position + distance * axis
        solids.append(Window(f"w{number}", place, normal, 10, Glass(1.46), size=size, **other))
    return Scene(tuple(solids))


def behind(truth, scene):
    """Return the simulated rig that looks through a scene."""
    return replace(truth, rig=truth.rig.through(scene))


@pytest.fixture(scope="module")
def windowed(simulated_rig):
    """Three cameras behind a window each, their observations, and those without windows."""
    truth = simulated_rig("arc", cameras=3, frames=8, seed=1)
    scene = windows_before(truth.rig, 300, 220)
    looking = behind(truth, scene)
    return truth, scene, looking, looking.observe(NOISE, seed=1)


@pytest.fixture(scope="module")
def found(windowed):
    return calibrate(windowed[3], scene=windowed[1], distortion="brown4")


def test_a_window_costs_no_accuracy(windowed, found, judged_volume):
    truth, _, looking, _ = windowed
    points = judged_volume(truth)
    bare = calibrate(truth.observe(NOISE, seed=1), distortion="brown4")
    free = ray_miss(truth.rig, bare.rig, points)
    assert ray_miss(looking.rig, found.rig, points) < 1.2 * free
    assert found.used.all()
    assert found.noise == pytest.approx(NOISE, rel=0.05)
    assert found.quality.predicted_ray_miss < 1.1 * bare.quality.predicted_ray_miss
    assert found.looked_through == (("w0",), ("w1",), ("w2",))
    assert found.rig.calibration["cameras"]["cam01"]["looked_through"] == ["w1"]


def test_residuals_are_measured_less_seen_through_the_rig(windowed, found, tmp_path):
    _, scene, _, observations = windowed
    assert found.rig.scene == scene
    save_rig(found.rig, tmp_path / "rig.yaml")
    rig = load_rig(tmp_path / "rig.yaml")
    for row in (0, 200, len(observations) - 1):
        frame = observations.frame[row]
        point = observations.target_points[observations.point[row]]
        place = found.target_R[frame] @ point + found.target_t[frame]
        uv, _, _ = rig[int(observations.camera[row])].project(place[None])
        assert np.abs(observations.uv[row] - uv[0] - found.residuals[row]).max() < 1e-8


def test_windows_are_found_within_their_errors(windowed):
    """The window given is of another thickness and direction than the one that is there."""
    truth, _, _, _ = windowed
    steep = windows_before(truth.rig, 300, 300, angle=55.0)
    observations = behind(truth, steep).observe(0.005, seed=1)
    turn = Rotation.from_rotvec([0.01, 0.015, 0]).as_matrix()
    given = Scene(
        tuple(
            replace(solid, normal=tuple(turn @ solid.normal), thickness=10.5)
            for solid in steep.solids
        )
    )
    priors = [WindowPrior(f"w{k}", normal=1, thickness=0.5) for k in range(3)]
    calibration = calibrate(observations, scene=given, windows=priors, distortion="brown4")
    assert calibration.noise == pytest.approx(0.005, rel=0.1)
    for window, true in zip(calibration.windows, steep.solids, strict=True):
        normal, _, thickness = window.errors
        assert thickness < 0.5
        assert abs(window.thickness - true.thickness) < 3 * thickness
        turned = np.degrees(np.arccos(min(np.dot(window.normal, true.normal), 1.0)))
        assert turned < 3 * np.hypot(normal, normal)
        assert window.priors == pytest.approx((1, 0, 0.5))
        assert window.changes[1] == pytest.approx(0, abs=1e-9)
    names = {name for name, _ in calibration.parameters}
    assert {"w0", "w1", "w2"} <= names
    assert any(line.startswith("window w0: normal turned by") for line in calibration.findings)
    assert set(calibration.rig.calibration["windows"]) == {"w0", "w1", "w2"}


@pytest.fixture(scope="module")
def in_water(simulated_rig):
    """Three cameras that look into a tank through one wall; targets in the water."""
    truth = simulated_rig("arc", cameras=3, frames=8, seed=3, spread=20.0)
    scene = windows_before(truth.rig, 380, 180, angle=8.0, beyond="water")
    return truth, scene, behind(truth, scene)


def test_targets_in_water_fit_to_the_noise(in_water, judged_volume):
    truth, scene, looking = in_water
    observations = looking.observe(NOISE, seed=2)
    calibration = calibrate(observations, scene=scene, distortion="brown4")
    assert calibration.noise == pytest.approx(NOISE, rel=0.05)
    assert calibration.used.all()
    miss = ray_miss(looking.rig, calibration.rig, judged_volume(truth))
    assert miss < 1.5 * calibration.quality.predicted_ray_miss
    for true, camera in zip(truth.rig, calibration.rig, strict=True):
        focal = camera.camera.camera_matrix[0, 0]
        assert focal == pytest.approx(true.camera_matrix[0, 0], rel=0.05)  # not 1.33 times


def test_lenses_given_in_air_fit_in_water_in_the_world_of_a_frame(in_water, judged_volume):
    truth, scene, looking = in_water
    R, t = truth.target_R[4], truth.target_t[4]
    calibration = calibrate(
        looking.observe(NOISE, seed=2),
        scene=scene.transformed(R.T, -R.T @ t),
        world="004",
        intrinsics=truth.rig,
    )
    assert np.abs(calibration.target_R[4] - np.eye(3)).max() < 1e-9
    assert calibration.noise == pytest.approx(NOISE, rel=0.05)
    assert ray_miss(looking.rig, calibration.rig, judged_volume(truth)) < 0.01
    for camera, true in zip(calibration.rig, truth.rig, strict=True):
        assert np.linalg.norm(camera.camera.position - R.T @ (true.position - t)) < 2.0


def near(truth):
    """Return cameras at 300 in place of 800, with wide lenses, in the axes of the first."""
    cameras = []
    for camera in truth.rig:
        K = camera.camera_matrix * np.array([[1 / 3], [1 / 3], [1]])
        K[:2, 2] = camera.camera_matrix[:2, 2]
        cameras.append(replace(camera, camera_matrix=K, t=camera.t - [0, 0, 500]))
    first, rig = cameras[0], Rig(tuple(cameras))
    return replace(
        truth,
        rig=rig.transformed(first.R, first.t),
        target_R=first.R @ truth.target_R,
        target_t=truth.target_t @ first.R.T + first.t,
    )


def test_a_pane_that_nobody_mentioned_is_said_and_nothing_else_is(simulated_rig):
    truth = near(simulated_rig("arc", cameras=2, frames=12, seed=4))
    pane = behind(truth, Scene(windows_before(truth.rig, 90, 140, angle=30.0).solids[1:]))
    found = calibrate(pane.observe(0.01, seed=4, facing=0.3))
    lines = [line for line in found.findings if "look like" in line]
    assert len(lines) == 1
    assert lines[0].startswith("camera cam01: its residuals look like")
    assert "--scene" in lines[0]
    assert not found.assessment.startswith("good")
    bare = calibrate(truth.observe(0.01, seed=4, facing=0.3))
    assert not any("look like" in line for line in bare.findings)


# Bad input


def test_a_window_that_no_camera_looks_through_is_refused(windowed):
    _, scene, _, observations = windowed
    away = Scene((replace(scene.solids[0], point=(0, 0, -900)),))
    with pytest.raises(ValueError, match="solid w0: found between no camera and the target"):
        calibrate(observations, scene=away, distortion="radial")


def test_a_camera_in_glass_is_refused(windowed):
    _, _, _, observations = windowed
    block = Scene((Window("block", (0, 0, -20), (0, 0, -1), 60, Glass(1.5)),))
    with pytest.raises(ValueError, match="camera cam00: stands inside solid block"):
        calibrate(observations, scene=block, distortion="radial")


def test_total_reflection_is_refused(windowed):
    _, _, _, observations = windowed
    steep = Window("steep", (0, 0, 200), (0.95, 0, -0.3), 10, Glass(1.4), size=900)
    with pytest.raises(ValueError, match=r"camera cam00: light of all .* is totally reflected"):
        calibrate(observations, scene=Scene((steep,), medium=2.5), distortion="radial")


def test_unknown_windows_and_a_second_scale_are_refused(windowed):
    _, scene, _, observations = windowed
    with pytest.raises(ValueError, match="window pane: found no such window"):
        calibrate(observations, scene=scene, windows=[WindowPrior("pane", 1)])
    world = {name: np.eye(3)[k] for k, name in enumerate(observations.cameras)}
    with pytest.raises(ValueError, match="rescale: found True with a scene"):
        calibrate(observations, scene=scene, world=world, rescale=True)
