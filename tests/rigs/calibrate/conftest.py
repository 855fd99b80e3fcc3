"""Simulated observations: known cameras, a flat target in known places, noise of known size."""

from dataclasses import dataclass, replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from rigs import Camera, Distortion, Rig, arc, ring
from rigs.calibrate import Observations


@dataclass(frozen=True)
class Simulated:
    """True cameras, in the world of the first, and where the target truly was."""

    rig: Rig
    points: np.ndarray
    target_R: np.ndarray  # noqa: N815 (the field's symbol)
    target_t: np.ndarray

    def observe(self, noise, seed, facing=0.5, partial=True, least=4):
        """Return noisy observations of all points that face a camera and are in its image."""
        rng = np.random.default_rng(seed)
        rows, pixels = [], []
        for f, (R, t) in enumerate(zip(self.target_R, self.target_t, strict=True)):
            places = self.points @ R.T + t
            for c, camera in enumerate(self.rig):
                sight = places.mean(axis=0) - camera.position
                uv, _, valid = camera.project(places)
                valid &= camera.inside(np.where(valid[:, None], uv, -9))
                seen = np.flatnonzero(valid)
                turned_away = R[:, 2] @ sight < facing * np.linalg.norm(sight)
                if turned_away or len(seen) < least or not (partial or valid.all()):
                    continue
                rows += [(c, f, point) for point in seen]
                pixels.append(uv[seen] + noise * rng.standard_normal((len(seen), 2)))
        camera, frame, point = np.transpose(rows)
        return Observations(
            self.points,
            self.rig.names,
            tuple(camera.image_size for camera in self.rig),
            tuple(f"{f:03d}" for f in range(len(self.target_t))),
            camera,
            frame,
            point,
            np.concatenate(pixels),
        )


def board(columns=6, rows=5, square=18.0):
    """Return the inner corners of a chessboard."""
    grid = np.mgrid[:rows, :columns].reshape(2, -1).T
    return np.c_[grid[:, ::-1] * square, np.zeros(len(grid))]


def simulate(kind="arc", cameras=4, frames=14, seed=0, points=None, tilt=32, spread=25.0):
    """Return a rig with lenses of its own round a volume of 50, and target poses in it."""
    rng = np.random.default_rng(seed)
    options = {"image_size": (640, 480), "footprint": 0.32}
    if kind == "arc":
        rig, turns = arc(cameras, 100, 800, **options), rng.uniform(-50, 50, frames)
    else:
        rig = ring(cameras, None, 800, **options)
        turns = np.arange(frames) * 360 / frames + rng.uniform(-10, 10, frames)
    bent = []
    for camera in rig:
        K = camera.camera_matrix.copy()
        K[0, 0] *= 1 + 0.02 * rng.standard_normal()
        K[1, 1] = K[0, 0] * (1 + 0.002 * rng.standard_normal())
        K[:2, 2] += rng.normal(0, 6, 2)
        lens = np.array([-0.15, 0.1, 0.001, -0.0007]) * (1 + 0.2 * rng.standard_normal(4))
        bent.append(Camera(camera.name, camera.image_size, K, Distortion("brown", lens),
                           camera.R, camera.t))  # fmt: skip
    points = board() if points is None else points
    angles = np.c_[turns, rng.uniform(-tilt, tilt, frames), rng.uniform(-30, 30, frames)]
    angles[:, 0] += rng.uniform(-tilt, tilt, frames) / 2
    facing = Rotation.from_euler("x", 180, degrees=True)
    R = (Rotation.from_euler("YXZ", angles, degrees=True) * facing).as_matrix()
    t = rng.uniform(-spread, spread, (frames, 3)) - R @ points.mean(axis=0)
    first = bent[0]
    world = replace(rig, cameras=tuple(bent)).transformed(first.R, first.t)
    return Simulated(world, points, first.R @ R, t @ first.R.T + first.t)


def volume_points(simulated, half=25.0, count=5):
    """Return points of a cube about the middle of the volume, in the simulated world."""
    axis = np.linspace(-half, half, count)
    cube = np.stack(np.meshgrid(axis, axis, axis), axis=-1).reshape(-1, 3)
    return cube + np.array([0, 0, 800.0])


@pytest.fixture(scope="session")
def simulated_rig():
    """Return `simulate`."""
    return simulate


@pytest.fixture(scope="session")
def judged_volume():
    """Return `volume_points`."""
    return volume_points


@pytest.fixture(scope="session")
def one_camera():
    """Return a function: the observations of one camera as a rig of its own."""

    def own(observations, camera=0):
        mine = observations.where(observations.camera == camera)
        return Observations(
            mine.target_points,
            mine.cameras[camera : camera + 1],
            mine.image_sizes[camera : camera + 1],
            mine.frames,
            mine.camera * 0,
            mine.frame,
            mine.point,
            mine.uv,
        )

    return own


def film(offsets, frames=20, seed=0, noise=0.1, noise_seed=0, step=1):
    """Return a rig and what its cameras saw of a board moved by hand, 30 pictures a second.

    Camera k took its picture f at the moment ``f + offsets[k]``, counted in pictures. The board
    moves along sines of 0.15 to 1 Hz, some 8 pixels a picture, and every ``step``-th is kept.
    """
    still = simulate(cameras=len(offsets), frames=1, seed=seed, points=board(5, 4, 24.0))
    rig = still.rig
    rng = np.random.default_rng([seed, 9])
    rate, phase = rng.uniform(0.15, 1.0, (6, 4)), rng.uniform(0, 2 * np.pi, (6, 4))
    size = rng.standard_normal((6, 4)) * np.array([30, 22, 30, 20, 20, 20])[:, None] / 2

    def poses(times):
        waves = np.sin(2 * np.pi * rate * times[:, None, None] / 30 + phase)  # (times, 6, 4)
        value = (size * waves).sum(axis=2)
        facing = Rotation.from_euler("x", 180, degrees=True)
        R = (Rotation.from_euler("YXZ", value[:, :3], degrees=True) * facing).as_matrix()
        t = value[:, 3:] - R @ still.points.mean(axis=0)
        first = arc(len(offsets), 100, 800, image_size=(640, 480), footprint=0.32)[0]
        return first.R @ R, t @ first.R.T + first.t

    times = np.arange(0, frames * step, step, dtype=float)
    seen = []
    for camera, offset in enumerate(offsets):
        R, t = poses(times + offset)
        own = replace(still, target_R=R, target_t=t, rig=Rig(rig.cameras[camera : camera + 1]))
        one = own.observe(noise, [seed, camera, noise_seed], facing=0.3, partial=False)
        seen.append((one, np.full(len(one), camera)))
    observations = Observations(
        still.points,
        rig.names,
        tuple(camera.image_size for camera in rig),
        tuple(f"{int(time):06d}" for time in times),
        np.concatenate([camera for _, camera in seen]),
        np.concatenate([one.frame for one, _ in seen]),
        np.concatenate([one.point for one, _ in seen]),
        np.concatenate([one.uv for one, _ in seen]),
    )
    return rig, observations


@pytest.fixture(scope="session")
def moving_target():
    """Return `film`."""
    return film
