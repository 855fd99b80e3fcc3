"""Rigs with known truth, poses of a target before them, and sets of pictures on disk."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from rigs import Camera, Distortion, Rig, Volume, arc, ring
from rigs.calibrate.targets import parse_target
from studies.calibration.rendering import Board, Exposure, Photographer, developed

FOOTPRINT = 0.32  # mm: a pixel's size in the middle of the volume
DISTANCE = 600.0  # mm
IMAGE_SIZE = (800, 640)
VOLUME = Volume((40, 60, 40), 2.0)


@dataclass(frozen=True)
class Poses:
    """How targets are held before a rig; lengths in mm, angles in degrees, all from -x to x."""

    count: int = 30
    facing: float = 25.0  # the direction on the circle that the target faces
    # tilt, roll: about the target's own level axis, and in its own plane
    tilt: float = 30.0
    roll: float = 30.0
    # shift, depth: of the target's middle from the volume's: sideways and upward, and towards the
    # viewer
    shift: float = 60.0
    depth: float = 60.0


COMPLETE = Poses(facing=12.0, tilt=25.0, roll=12.0, shift=14.0, depth=35.0)


def arc_rig(seed: int = 0, count: int = 5, span_degrees: float = 120.0) -> Rig:
    """Return cameras over an arc, no two alike and none quite where it was meant to be."""
    pitch = np.resize([4.0, -6.0, 10.0], count)
    rig = arc(count, span_degrees, DISTANCE, pitch_degrees=pitch, **_LAYOUT)
    return _as_built(rig, np.random.default_rng([seed, 1]))


def ring_rig(seed: int = 0, count: int = 12) -> Rig:
    """Return cameras all round, no two alike."""
    pitch = np.resize([0.0, 14.0, -8.0], count)
    rig = ring(count, distance=DISTANCE, pitch_degrees=pitch, **_LAYOUT)
    return _as_built(rig, np.random.default_rng([seed, 2]))


_LAYOUT = {"image_size": IMAGE_SIZE, "footprint": FOOTPRINT, "volume": VOLUME}


def _as_built(rig: Rig, generator: np.random.Generator) -> Rig:
    """Return the rig with lenses that bend and mounts that are not where the drawing has them."""
    cameras = [_camera_as_built(camera, generator) for camera in rig]
    return replace(rig, cameras=tuple(cameras))


def _camera_as_built(camera: Camera, generator: np.random.Generator) -> Camera:
    from scipy.spatial.transform import Rotation

    K = camera.camera_matrix.copy()
    K[[0, 1], [0, 1]] *= 1 + 0.01 * generator.standard_normal()
    K[1, 1] *= 1 + 3e-4 * generator.standard_normal()
    K[:2, 2] += 4 * generator.standard_normal(2)
    k1, k2 = [-0.18, 0.12] + [0.03, 0.03] * generator.standard_normal(2)
    p1, p2 = 5e-4 * generator.standard_normal(2)
    turn = Rotation.from_rotvec(np.deg2rad(0.5) * generator.standard_normal(3)).as_matrix()
    return replace(
        camera,
        camera_matrix=K,
        distortion=Distortion("brown", (k1, k2, p1, p2)),
        R=turn @ camera.R,
        t=camera.t + 4 * generator.standard_normal(3),
    )


def held(
    poses: Poses, middle: NDArray[np.float64], generator: np.random.Generator
) -> tuple[NDArray, NDArray]:
    """Return targets' poses, ``(count, 3, 3)`` and ``(count, 3)``: ``x_world = R x_target + t``.

    ``middle`` is the target's in its own axes.
    """
    from scipy.spatial.transform import Rotation

    n = poses.count
    facing, tilt, roll, side, up, depth = (
        limit * generator.uniform(-1, 1, n)
        for limit in (
            poses.facing, poses.tilt, poses.roll, poses.shift, 0.8 * poses.shift, poses.depth,
        )
    )  # fmt: skip
    if poses.facing == 180:  # all round: evenly, so that no camera goes without
        facing = np.arange(n) * 360.0 / n + facing / n
    round_the_axis = Rotation.from_euler("y", facing[:, None], degrees=True)
    upright = Rotation.from_euler("x", 180, degrees=True)  # printed side towards +z
    own = Rotation.from_euler("xz", np.stack([tilt, roll], axis=-1), degrees=True)
    R = (round_the_axis * upright * own).as_matrix()
    centre = round_the_axis.apply(np.stack([side, up, depth], axis=-1))
    return R, centre - R @ middle


def photograph(
    folder: Path,
    rig: Rig,
    board: Board,
    poses: tuple[NDArray, NDArray],
    *,
    seed: int = 0,
    exposure: Exposure | None = None,
    workers: int = 2,
) -> dict[str, dict[str, Path]]:
    """Write every camera's picture of every pose; return ``images[camera][frame]``, the files.

    A camera that would see the back of the target, or nothing of it, takes no picture.
    """
    import cv2

    exposure = Exposure() if exposure is None else exposure
    images: dict[str, dict[str, Path]] = {}
    for number, camera in enumerate(rig):
        photographer = Photographer(camera)
        (folder / camera.name).mkdir(parents=True, exist_ok=True)

        def take(frame: int, camera=camera, photographer=photographer, number=number) -> Path:
            R, t = (part[frame] for part in poses)
            picture = photographer.picture(board, R, t, exposure)
            generator = np.random.default_rng([seed, number, frame])
            path = folder / camera.name / f"pose_{frame:03d}.png"
            if not cv2.imwrite(str(path), developed(picture, exposure, generator)):
                raise OSError(f"{path}: cannot be written")
            return path

        seen = [f for f in range(len(poses[0])) if faces(camera, poses[0][f], poses[1][f])]
        with ThreadPoolExecutor(workers) as pool:
            paths = list(pool.map(take, seen))
        images[camera.name] = {path.stem: path for path in paths}
    return images


def faces(camera: Camera, R: NDArray, t: NDArray, most_degrees: float = 80.0) -> bool:
    """Say whether a camera sees the printed side of a target at a useful angle."""
    sight = t - camera.position
    return bool(R[:, 2] @ sight > np.cos(np.deg2rad(most_degrees)) * np.linalg.norm(sight))


TARGET = "charuco:9x7:18:13.5:DICT_4X4_50"
"""In mm; 48 inner corners on 162 x 126 mm, seen in images of 256 x 205 mm."""

TEXELS = 12.0
"""Texels of the print in a millimetre: squares and markers' cells are whole numbers of them."""


@dataclass(frozen=True)
class Case:
    """A kind of rig and of poses."""

    # name, words: a word for files, and what it is
    name: str
    words: str
    make: Callable[[int, int], Rig]
    poses: Poses
    complete: bool  # whether only images that show the whole target are used
    cameras: int

    def rig(self, seed: int) -> Rig:
        """Return the true rig, which is another for each seed."""
        return self.make(seed, self.cameras)


CASES = (
    Case("arc", "5 cameras over 120 degrees, partial boards", arc_rig, Poses(30), False, 5),
    Case("ring", "12 cameras all round, partial boards", ring_rig, Poses(36, 180.0), False, 12),
    Case(
        "arc_complete", "5 cameras over 120 degrees, complete boards", arc_rig,
        replace(COMPLETE, count=30), True, 5,
    ),
    Case(
        "ring_complete", "12 cameras all round, complete boards", ring_rig,
        replace(COMPLETE, count=36, facing=180.0), True, 12,
    ),
)  # fmt: skip

SMALL = "3 cameras over 60 degrees, complete boards"
TINY = (Case("arc_complete", SMALL, arc_rig, replace(COMPLETE, count=6), True, 3),)
"""One small case: whether the study runs at all."""


def pictures(case: Case, seed: int, folder: Path, workers: int = 2) -> dict[str, dict[str, Path]]:
    """Render a case's images, ``images[camera][frame]``; the seed is of rig, poses and noise."""
    target = parse_target(TARGET)
    return photograph(
        folder / f"{case.name}_{seed}",
        case.rig(seed),
        Board.of(target, TEXELS),
        held(case.poses, target.points.mean(axis=0), np.random.default_rng([seed, 3])),
        seed=seed,
        workers=workers,
    )
