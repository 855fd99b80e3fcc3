"""Windows that are adjusted, routes to points, and the adjustment's derivatives through them."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from rigs.calibrate.adjust.freedom import Freedom
from rigs.calibrate.adjust.observation_arrays import (
    ObservationArrays,
    Scene,
    jacobian,
    predicted,
    rays_by_camera,
    world_points,
)
from rigs.calibrate.adjust.projection import Lens
from rigs.calibrate.refraction import HIDDEN, PASSES, Refraction, WindowPrior, routes_to
from rigs.scene import Cylinder, Glass, Opaque, Window
from rigs.scene import Scene as OpticalScene

LENS = Lens(np.array([[900.0, 0, 321], [0, 905, 236], [0, 0, 1]]), "brown",
            np.array([-0.2, 0.1, 0.002, -0.001, 0.03]))  # fmt: skip
WINDOW = Window("quartz", (0.1, 0, 1), (0.3, 0.1, -1), 0.05, Glass(1.46), beyond="water")


def unknowns(*priors, solids=(WINDOW,)):
    """Two cameras, three tilted targets behind a window, and what they see without noise."""
    rng = np.random.default_rng(0)
    grid = np.mgrid[-2:3, -2:3].reshape(2, -1).T * 0.1
    points = np.c_[grid, np.zeros(len(grid))]
    scene = Scene(
        (LENS,) * 2,
        Rotation.from_rotvec(0.05 * rng.standard_normal((2, 3))).as_matrix(),
        0.1 * rng.standard_normal((2, 3)),
        Rotation.from_rotvec(0.5 * rng.standard_normal((3, 3))).as_matrix(),
        0.15 * rng.standard_normal((3, 3)) + [0, 0, 2],
        refraction=Refraction.of(OpticalScene(solids), priors),
    )
    camera, frame, point = np.mgrid[:2, :3, : len(points)].reshape(3, -1)
    arrays = ObservationArrays(camera, frame, points[point], np.zeros((len(camera), 2)))
    routes = np.full((len(camera), 2), -1)
    for number, center in enumerate(scene.centers()):
        own = camera == number
        found, ends = routes_to(scene.refraction, center, world_points(scene, arrays)[own])
        assert (ends == PASSES).all()
        routes[own, : found.shape[1]] = found
    arrays = replace(arrays, routes=routes)
    return scene, replace(arrays, uv=predicted(scene, arrays))


def test_derivatives_of_the_adjustment_match_differences():
    scene, arrays = unknowns(WindowPrior("quartz", 1, 1, 1))
    rows = slice(0, len(arrays) // 2)
    uv, by_camera, by_target = jacobian(scene, arrays, 0, rows)
    assert np.abs(uv - arrays.uv[rows]).max() < 1e-9
    size, windows = 6 + LENS.size, scene.refraction.size
    assert by_camera.shape[2] == size + 1 + windows

    def moved(step):
        turn = Rotation.from_rotvec(step[:3]).as_matrix()
        tilt = Rotation.from_rotvec(step[-6:-3]).as_matrix()
        return replace(
            scene,
            lenses=(LENS.moved(step[6:size]), LENS),
            camera_R=np.stack([turn @ scene.camera_R[0], scene.camera_R[1]]),
            camera_t=scene.camera_t + np.array([step[3:6], [0, 0, 0]]),
            target_R=tilt @ scene.target_R,
            target_t=scene.target_t + step[-3:],
            refraction=scene.refraction.moved(step[size + 1 : -6]),
        )

    exact = np.concatenate([by_camera, by_target], axis=2)
    for index in range(exact.shape[2]):
        step = np.zeros(exact.shape[2])
        h = step[index] = 1e-2 if 6 <= index < 10 else 1e-5
        ahead, behind = (predicted(moved(s * step), arrays)[rows] for s in (1, -1))
        scale = max(np.abs(exact[:, :, index]).max(), 1.0)
        assert np.abs((ahead - behind) / 2 / h - exact[:, :, index]).max() < 1e-6 * scale, index


def test_rays_have_the_derivatives_of_the_observations():
    scene, arrays = unknowns(WindowPrior("quartz", 1))
    rows = slice(0, len(arrays) // 2)
    _, by_camera, _ = jacobian(scene, arrays, 0, rows)
    points = world_points(scene, arrays)[rows]
    by_world, other = rays_by_camera(scene, 0, points)
    assert np.abs(other - by_camera).max() < 1e-9 * np.abs(by_camera).max()
    assert by_world.shape == (len(points), 2, 3)


def test_freedom_shares_windows_between_cameras():
    free = Freedom(
        (np.ones(4, bool),) * 2,
        np.array([False, True]),
        windows=np.array([True, True, False, True]),
    )
    assert free.size == 4 + 10 + 3
    assert free.places[0][-4:].tolist() == free.places[1][-4:].tolist() == [14, 15, -1, 16]
    own, by_parameter = free.gathered(0, np.eye(6 + 4 + 1 + 4))
    assert own.tolist() == [0, 1, 2, 3, 14, 15, 16]
    assert by_parameter.sum() == 7
    assert free.window_step(np.arange(17.0)).tolist() == [14, 15, 0, 16]


def test_moves_of_a_window_are_the_changes_that_its_prior_weighs():
    bending = Refraction.of(OpticalScene((WINDOW,)), (WindowPrior("quartz", 2, 0.1, 0),))
    step = np.array([1e-3, -2e-3, 0.01, 0.02])
    moved = bending.moved(step)
    assert np.abs(moved.changes - step).max() < 1e-5
    degree = np.radians(2)
    noisy = replace(moved, noise=0.1)
    assert noisy.weights == pytest.approx([(0.1 / degree) ** 2] * 2 + [1.0, 0.0])
    scaled = moved.with_lengths_scaled(10)
    assert scaled.changes == pytest.approx(moved.changes * [1, 1, 10, 10])
    assert scaled.deviations == pytest.approx(moved.deviations * [1, 1, 10, 10])


def test_hardware_in_the_way_is_said():
    rod = Cylinder("rod", (0, 0, 0.6), (0, 1, 0), 0.1, 3, Opaque())
    bending = Refraction.of(OpticalScene((WINDOW, rod)))
    routes, ends = routes_to(bending, np.zeros(3), np.array([[0, 0, 2.0], [1, 0, 2.0]]))
    assert ends.tolist() == [HIDDEN, PASSES]
    assert routes[1].tolist() == [0, 1]


def test_priors_are_read_and_refused():
    assert WindowPrior.parsed("a: b:distance=3") == WindowPrior("a: b", distance=3.0)
    for text in ("quartz", "quartz:depth=1", "quartz:normal", ":normal=1", "q:normal=x"):
        with pytest.raises(ValueError, match="expected NAME:normal=DEGREES"):
            WindowPrior.parsed(text)
    with pytest.raises(ValueError, match="standard deviations"):
        WindowPrior("quartz", normal=-1)
    with pytest.raises(ValueError, match=r"window glass: found no such window, expected .*quartz"):
        Refraction.of(OpticalScene((WINDOW,)), (WindowPrior("glass", 1),))
