"""The adjustment against derivatives by differences, a dense solver, and its own invariances."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from rigs import Camera, Distortion
from rigs.calibrate.adjust.bundle import adjust, information
from rigs.calibrate.adjust.culling import adjust_robustly
from rigs.calibrate.adjust.freedom import Freedom
from rigs.calibrate.adjust.observation_arrays import (
    ObservationArrays,
    Scene,
    jacobian,
    predicted,
)
from rigs.calibrate.adjust.projection import Lens, project

MATRIX = np.array([[900.0, 0.7, 321.0], [0, 905.0, 236.0], [0, 0, 1]])
MODELS = {
    "none": (),
    "brown": (-0.2, 0.1, 0.002, -0.001, 0.03),
    "rational": (0.3, 0.1, 0.001, 0.002, 0.02, 0.5, 0.2, 0.03),
    "thin_prism": (-0.2, 0.1, 0.001, 0.002, 0.02, 0.1, 0.05, 0.01, 0.003, -0.002, 0.001, 0.004),
    "tilted": (-0.2, 0.1, 0.001, 0.002, 0.02, 0.1, 0.05, 0.01, 0.003, -0.002, 0.001, 0.004,
               0.03, -0.05),
    "fisheye": (-0.02, 0.01, 0.003, -0.001),
}  # fmt: skip


def lens(model):
    return Lens(MATRIX, model, np.array(MODELS[model]))


def scene(model, cameras=3, frames=4, seed=0):
    """Cameras side by side, tilted targets before them, and observations without noise."""
    rng = np.random.default_rng(seed)
    grid = np.mgrid[-2:3, -2:3].reshape(2, -1).T * 0.1
    points = np.c_[grid, np.zeros(len(grid))]
    truth = Scene(
        (lens(model),) * cameras,
        Rotation.from_rotvec(0.05 * rng.standard_normal((cameras, 3))).as_matrix(),
        0.1 * rng.standard_normal((cameras, 3)) + [0, 0, 2],
        Rotation.from_rotvec(0.5 * rng.standard_normal((frames, 3))).as_matrix(),
        0.15 * rng.standard_normal((frames, 3)),
    )
    camera, frame, point = np.mgrid[:cameras, :frames, : len(points)].reshape(3, -1)
    blank = ObservationArrays(camera, frame, points[point], np.zeros((len(camera), 2)))
    return truth, replace(blank, uv=predicted(truth, blank))


def all_free(truth):
    pose = np.arange(len(truth.lenses)) > 0
    return Freedom(tuple(np.ones(lens.size, bool) for lens in truth.lenses), pose)


def disturbed(truth, size, seed=1):
    rng = np.random.default_rng(seed)
    turn = Rotation.from_rotvec(size * rng.standard_normal((len(truth.target_t), 3))).as_matrix()
    lenses = tuple(
        Lens(one.matrix * [[1 + size, 1, 1], [1, 1 + size, 1], [1, 1, 1]], one.model,
             one.coefficients)
        for one in truth.lenses
    )  # fmt: skip
    return replace(
        truth,
        lenses=lenses,
        target_R=turn @ truth.target_R,
        target_t=truth.target_t + size * rng.standard_normal(truth.target_t.shape),
    )


@pytest.mark.parametrize("model", MODELS)
def test_projection_is_the_cameras_own(model):
    points = np.random.default_rng(2).uniform([-0.4, -0.3, 1], [0.4, 0.3, 2], (40, 3))
    camera = Camera("a", (640, 480), MATRIX, Distortion(model, MODELS[model]))
    uv, _, valid = camera.project(points)
    assert valid.all()
    assert np.abs(project(lens(model), points)[0] - uv).max() < 1e-9


@pytest.mark.parametrize("model", MODELS)
def test_derivatives_match_differences(model):
    truth, observations = scene(model, cameras=1, frames=1)
    uv, by_camera, by_target = jacobian(truth, observations, 0, slice(0, len(observations)))
    assert np.array_equal(uv, predicted(truth, observations))

    def moved(camera_step, target_step):
        turn = Rotation.from_rotvec([camera_step[:3], target_step[:3]]).as_matrix()
        return Scene(
            (truth.lenses[0].moved(camera_step[6:]),),
            turn[:1] @ truth.camera_R,
            truth.camera_t + camera_step[3:6],
            turn[1:] @ truth.target_R,
            truth.target_t + target_step[3:],
        )

    size = by_camera.shape[2]
    numeric = np.zeros((*uv.shape, size + 6))
    for index in range(size + 6):
        step = np.zeros(size + 6)
        h = step[index] = 1e-2 if 6 <= index < 10 else 1e-5  # pixels; radians and lengths
        ahead, behind = (moved(s * step[:size], s * step[size:]) for s in (1, -1))
        numeric[:, :, index] = (
            (predicted(ahead, observations) - predicted(behind, observations)) / 2 / h
        )
    exact = np.concatenate([by_camera, by_target], axis=2)
    scale = np.abs(exact).max(axis=(0, 1))
    assert (np.abs(exact - numeric).max(axis=(0, 1)) < 1e-6 * np.maximum(scale, 1)).all()


def test_fisheye_sees_beside_and_on_the_axis():
    points = np.array([[0.0, 0, 2], [1, 0.2, 0.0], [1, 1, -0.2], [1e-7, 0, 1]])
    camera = Camera("a", (640, 480), MATRIX, Distortion("fisheye", MODELS["fisheye"]))
    uv, by_point, _ = project(lens("fisheye"), points)
    assert np.abs(uv - camera.project(points)[0]).max() < 1e-9
    for axis in range(3):
        step = 1e-5 * np.eye(3)[axis]
        ahead, behind = (project(lens("fisheye"), points + s * step)[0] for s in (1, -1))
        assert np.abs(by_point[:, :, axis] - (ahead - behind) / 2e-5).max() < 1e-3


@pytest.mark.parametrize("model", ["brown", "fisheye"])
def test_exact_data_give_the_truth(model):
    truth, observations = scene(model, frames=8)
    free = Freedom(
        tuple(np.r_[np.ones(6, bool), np.zeros(one.size - 6, bool)] for one in truth.lenses),
        np.arange(3) > 0,
    )
    solution = adjust(disturbed(truth, 0.02), observations, free, tolerance=1e-14)
    assert np.abs(solution.residuals).max() < 1e-6
    for found, true in zip(solution.scene.lenses, truth.lenses, strict=True):
        assert np.abs(found.matrix - true.matrix).max() < 1e-3
    assert np.abs(solution.scene.camera_t - truth.camera_t).max() < 1e-5


def test_elimination_equals_the_dense_normal_equations():
    truth, exact = scene("brown", cameras=2, frames=5)
    noise = 0.3 * np.random.default_rng(3).standard_normal(exact.uv.shape)
    observations = replace(exact, uv=exact.uv + noise)
    free = Freedom(tuple(np.arange(9) < 4 for _ in truth.lenses), np.array([False, True]))
    solution = adjust(truth, observations, free, tolerance=1e-14)
    dense = np.zeros((len(observations), 2, 14 + 30))
    for camera in range(2):
        rows = slice(camera * len(observations) // 2, (camera + 1) * len(observations) // 2)
        _, by_camera, by_target = jacobian(solution.scene, observations, camera, rows)
        own, by_camera = free.gathered(camera, by_camera)
        dense[rows, :, own] = by_camera
        for frame in range(5):
            at = np.flatnonzero(observations.frame[rows] == frame)
            dense[rows.start + at, :, 14 + 6 * frame : 20 + 6 * frame] = by_target[at]
    dense = dense.reshape(-1, 44)
    full, slope = dense.T @ dense, dense.T @ solution.residuals.ravel()
    assert np.abs(slope / np.sqrt(np.diag(full))).max() < 1e-4  # a minimum, in every direction
    assert solution.cost < 0.5 * (noise**2).sum()
    reduced = full[:14, :14] - full[:14, 14:] @ np.linalg.solve(full[14:, 14:], full[14:, :14])
    matrix, gradient = information(solution.scene, observations, free)
    diagonal = np.sqrt(np.diag(reduced))
    assert np.abs((matrix - reduced) / np.outer(diagonal, diagonal)).max() < 1e-8
    assert np.abs(gradient / diagonal).max() < 1e-4


def test_units_of_length_do_not_matter():
    truth, exact = scene("brown")
    noise = 0.1 * np.random.default_rng(4).standard_normal(exact.uv.shape)
    observations = replace(exact, uv=exact.uv + noise)
    start = disturbed(truth, 0.01)
    one = adjust(start, observations, all_free(truth), tolerance=1e-14)
    large = replace(start, camera_t=start.camera_t * 1000, target_t=start.target_t * 1000)
    other = adjust(
        large,
        replace(observations, points=observations.points * 1000),
        all_free(truth),
        tolerance=1e-14,
    )
    assert other.cost == pytest.approx(one.cost, rel=1e-9)


def test_a_tenth_of_wrong_sightings_moves_huber_little():
    truth, exact = scene("brown", frames=8)
    rng = np.random.default_rng(5)
    noise = 0.1 * rng.standard_normal(exact.uv.shape)
    wrong = rng.uniform(size=len(exact)) < 0.1
    noise[wrong] = rng.uniform(-20, 20, (int(wrong.sum()), 2))
    observations = replace(exact, uv=exact.uv + noise)
    free = Freedom(tuple(np.arange(9) < 4 for _ in truth.lenses), np.arange(3) > 0)
    robust = adjust_robustly(truth, observations, free)
    plain = adjust(truth, observations, free)
    off = [
        np.abs(predicted(found.scene, exact) - exact.uv)[~wrong].max() for found in (robust, plain)
    ]
    assert off[0] < 0.3
    assert off[1] > 5 * off[0]


def test_a_start_behind_a_camera_is_refused():
    truth, observations = scene("none")
    behind = replace(truth, target_t=truth.target_t - [0, 0, 10])
    with pytest.raises(ValueError, match="behind its camera"):
        adjust(behind, observations, all_free(truth))
