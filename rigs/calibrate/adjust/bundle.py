"""One least-squares adjustment of all lenses, camera poses and target poses.

Each observation depends on one camera and one frame. The frames' 6 x 6 blocks of the normal
equations are therefore eliminated first (Schur complement), and the system that is solved has the
size of the cameras alone: Triggs, McLauchlan, Hartley and Fitzgibbon, "Bundle adjustment, a
modern synthesis" (2000), section 6.1.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from rigs.calibrate.adjust.freedom import Freedom
from rigs.calibrate.adjust.observation_arrays import (
    ObservationArrays,
    Scene,
    camera_rows,
    jacobian,
    predicted,
    runs,
)
from rigs.geometry.rotation import matrix_of_vector

_LEAST_GAIN = 1e-8  # relative fall of the cost below which iterations stop; more cost time
_DAMPING = 1e-4  # Marquardt's first damping, relative to the diagonal
_LEAST_DAMPING, _MOST_DAMPING = 1e-12, 1e9  # below rounding; beyond it no step is left


@dataclass(frozen=True)
class Solution:
    """An adjusted scene and the residuals left."""

    scene: Scene
    residuals: NDArray[np.float64]  # (N, 2) measured less projected, pixels
    cost: float
    iterations: int


@dataclass(frozen=True)
class Normal:
    """Normal equations in blocks; P camera parameters, F frames with observations."""

    cameras: NDArray[np.float64]  # (P, P)
    targets: NDArray[np.float64]  # (F, 6, 6)
    mixed: NDArray[np.float64]  # (F, P, 6)
    camera_gradient: NDArray[np.float64]  # (P,)
    target_gradient: NDArray[np.float64]  # (F, 6)
    frames: NDArray[np.int64]  # (F,) indices of these frames in the scene


def adjust(
    scene: Scene,
    observations: ObservationArrays,
    freedom: Freedom,
    *,
    huber: NDArray[np.float64] | None = None,
    iterations: int = 60,
    tolerance: float = _LEAST_GAIN,
) -> Solution:
    """Return the scene of least squared residuals, by Levenberg and Marquardt's method.

    The loss is linear beyond the residual length ``huber`` ``(N,)`` (Huber). Observed points have
    to lie before their cameras. ``tolerance`` is of the cost's relative fall, predicted or
    reached.
    """
    residuals, cost = _residuals(scene, observations, huber)
    if not np.isfinite(cost):
        raise ValueError("scene: found an observed point behind its camera, expected it in front")
    damping, iteration = _DAMPING, 0
    for _ in range(iterations):
        normal = normal_equations(scene, observations, freedom, huber)
        iteration += 1
        gain = 0.0
        while damping < _MOST_DAMPING:
            step = _solve(normal, damping)
            if step is not None:
                predicted_gain = _predicted_gain(normal, *step)
                if predicted_gain < tolerance * cost:
                    break
                trial = _moved(scene, freedom, normal.frames, *step)
                trial_residuals, trial_cost = _residuals(trial, observations, huber)
                if trial_cost < cost:
                    gain = (cost - trial_cost) / cost
                    ratio = (cost - trial_cost) / predicted_gain
                    scene, residuals, cost = trial, trial_residuals, trial_cost
                    # Where the prediction held, the next step may be longer
                    trust = 0.01 if ratio > 0.75 else 0.3 if ratio > 0.25 else 2.0
                    damping = max(damping * trust, _LEAST_DAMPING)
                    break
            damping *= 10
        if gain < tolerance:
            break
    return Solution(scene, residuals, cost, iteration)


def information(
    scene: Scene, observations: ObservationArrays, freedom: Freedom
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the normal equations ``(P, P)`` and gradient ``(P,)`` of cameras' free parameters.

    At unit pixel noise, target poses eliminated at their optimum; of half the squares.
    """
    normal = normal_equations(scene, observations, freedom, None)
    return reduced(normal, 0.0)[:2]


def fall_of_squares(
    matrix: NDArray[np.float64], gradient: NDArray[np.float64], free: NDArray[np.bool_]
) -> float:
    """Return the fall of the sum of squares if all of ``free`` ``(P,)`` were adjusted.

    It is of first order; matrix ``(P, P)`` and gradient ``(P,)`` are those of `information`.
    """
    scale, values, vectors = scaled_eigen(matrix[np.ix_(free, free)])
    along = vectors.T @ (gradient[free] * scale)
    known = values > 1e-10 * values[-1]
    return float((along[known] ** 2 / values[known]).sum())


def scaled_eigen(
    matrix: NDArray[np.float64],
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """Return the scale of each parameter that makes the diagonal 1; eigenvalues, vectors then."""
    scale = 1 / np.sqrt(np.maximum(np.diag(matrix), 1e-300))
    return scale, *np.linalg.eigh(matrix * np.outer(scale, scale))


def _residuals(
    scene: Scene, observations: ObservationArrays, huber: NDArray | None
) -> tuple[NDArray[np.float64], float]:
    """Return measured less projected ``(N, 2)`` and the cost; infinite behind a camera."""
    residuals = observations.uv - predicted(scene, observations)
    squares = (residuals**2).sum(axis=1)
    if huber is not None:
        length = np.sqrt(squares)
        squares = np.where(length > huber, huber * (2 * length - huber), squares)
    cost = float(squares.sum()) / 2
    if scene.refraction is not None:
        cost += float(scene.refraction.weights @ scene.refraction.changes**2) / 2
    return residuals, cost if np.isfinite(cost) else np.inf


def normal_equations(
    scene: Scene, observations: ObservationArrays, freedom: Freedom, huber: NDArray | None = None
) -> Normal:
    """Return the normal equations of Gauss and Newton, weighted for Huber's loss."""
    size = freedom.size
    frames = np.unique(observations.frame)
    cameras, camera_gradient = np.zeros((size, size)), np.zeros(size)
    targets, target_gradient = np.zeros((len(frames), 6, 6)), np.zeros((len(frames), 6))
    mixed = np.zeros((len(frames), size, 6))
    for camera, rows in camera_rows(observations):
        uv, by_camera, by_target = jacobian(scene, observations, camera, rows)
        residual = observations.uv[rows] - uv
        if huber is not None:
            length = np.linalg.norm(residual, axis=1)
            root = np.sqrt(np.minimum(1.0, huber[rows] / np.maximum(length, 1e-300)))
            residual = residual * root[:, None]
            by_camera, by_target = by_camera * root[:, None, None], by_target * root[:, None, None]
        own, by_camera = freedom.gathered(camera, by_camera)
        for frame, part in runs(observations.frame[rows]):
            index = int(np.searchsorted(frames, frame))
            r = residual[part].reshape(-1)
            A = by_camera[part].reshape(len(r), by_camera.shape[2])
            B = by_target[part].reshape(len(r), 6)
            targets[index] += B.T @ B
            target_gradient[index] += B.T @ r
            mixed[index, own] += A.T @ B
        flat = by_camera.reshape(2 * len(uv), by_camera.shape[2])
        cameras[np.ix_(own, own)] += flat.T @ flat
        camera_gradient[own] += flat.T @ residual.reshape(-1)
    if scene.refraction is not None:
        places = freedom.window_places
        free, place = places >= 0, places[places >= 0]
        weights = scene.refraction.weights[free]
        cameras[place, place] += weights
        camera_gradient[place] -= weights * scene.refraction.changes[free]
    return Normal(cameras, targets, mixed, camera_gradient, target_gradient, frames)


def reduced(
    normal: Normal, damping: float
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """Return the camera equations with the targets eliminated, and ``mixed inverse(targets)``.

    Marquardt's damping is relative to the diagonal, so that units do not matter.
    """
    diagonal = np.einsum("fii->fi", normal.targets)
    floor = 1e-14 * diagonal.max(axis=1, keepdims=True)
    targets = normal.targets + np.eye(6) * (damping * diagonal + floor)[:, None, :]
    solved = np.linalg.solve(targets, normal.mixed.transpose(0, 2, 1)).transpose(0, 2, 1)
    size = len(normal.cameras)
    width = 6 * len(targets)
    left = solved.transpose(1, 0, 2).reshape(size, width)
    right = normal.mixed.transpose(1, 0, 2).reshape(size, width)
    matrix = normal.cameras + np.diag(damping * np.diag(normal.cameras)) - left @ right.T
    gradient = normal.camera_gradient - left @ normal.target_gradient.reshape(-1)
    return (matrix + matrix.T) / 2, gradient, targets


def _solve(normal: Normal, damping: float) -> tuple[NDArray, NDArray] | None:
    """Return the damped step of the cameras ``(P,)`` and targets ``(F, 6)``, None on failure."""
    matrix, gradient, targets = reduced(normal, damping)
    camera_step = np.zeros(len(gradient))
    if len(gradient):
        scale = np.sqrt(np.maximum(np.diag(normal.cameras), 1e-300))
        try:
            camera_step = np.linalg.solve(matrix / np.outer(scale, scale), gradient / scale)
        except np.linalg.LinAlgError:  # too little damping here
            return None
        camera_step /= scale
    right = normal.target_gradient - np.einsum("fpi,p->fi", normal.mixed, camera_step)
    target_step = np.linalg.solve(targets, right[:, :, None])[:, :, 0]
    finite = np.isfinite(camera_step).all() and np.isfinite(target_step).all()
    return (camera_step, target_step) if finite else None


def _predicted_gain(normal: Normal, camera_step: NDArray, target_step: NDArray) -> float:
    """Return by how much the cost would fall, were the residuals linear in the parameters."""
    slope = normal.camera_gradient @ camera_step + (normal.target_gradient * target_step).sum()
    return float(slope) / 2


def _moved(
    scene: Scene,
    freedom: Freedom,
    frames: NDArray[np.int64],
    camera_step: NDArray[np.float64],
    target_step: NDArray[np.float64],
) -> Scene:
    """Return the scene after a step of the free parameters."""
    steps = [freedom.step(camera, camera_step) for camera in range(len(scene.lenses))]
    ends = [6 + lens.size for lens in scene.lenses]
    lenses = (
        lens.moved(step[6:end]) for lens, step, end in zip(scene.lenses, steps, ends, strict=True)
    )
    full = np.array([step[:6] for step in steps])
    later = np.array([step[end] for step, end in zip(steps, ends, strict=True)])
    bending = scene.refraction
    target_R, target_t = scene.target_R.copy(), scene.target_t.copy()
    target_R[frames] = matrix_of_vector(target_step[:, :3]) @ target_R[frames]
    target_t[frames] += target_step[:, 3:]
    return replace(
        scene,
        lenses=tuple(lenses),
        camera_R=matrix_of_vector(full[:, :3]) @ scene.camera_R,
        camera_t=scene.camera_t + full[:, 3:],
        target_R=target_R,
        target_t=target_t,
        offset=later if scene.offset is None else scene.offset + later,
        refraction=bending and bending.moved(freedom.window_step(camera_step)),
    )
