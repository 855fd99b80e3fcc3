"""Twelve known emissions and their images, taken by the model that is not the reconstruction's.

Four kinds, three kinds of noise, and each number of views three times. A camera more, of another
height and without noise, takes no part and judges what volumes predict.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike, NDArray

import phantoms
from rigs import Camera, Rig
from rigs.files import atomic_path
from rigs.files.size_guard import read_arrays
from studies.common.flames import with_noise
from studies.scenes import cameras
from studies.scenes.fields import FAMILIES, Field, KnownField
from studies.scenes.forward import radiance
from studies.scenes.scene import TRUTH_POINTS
from tomo import Scan, VoxelGrid, metrics
from tomo.operators import LinearSystem

GRID = VoxelGrid((40, 60, 40), 1.0, (1.3, -0.7, 0.4))
TINY_GRID = VoxelGrid((14, 20, 14), 1.0, (1.3, -0.7, 0.4))
VERSION = 1  # the version of the scenes; another one makes all of them anew
HELD = "held"


@dataclass(frozen=True)
class Emission:
    """Everything that determines a scene.

    The family is a field of `studies.scenes.fields`, a phantom, or one of `ROUND`; the rig as in
    `studies.scenes.cameras.rig`; the noise one of `studies.common.flames.NOISES`. The seed is that
    of field, cameras and noise; its remainder by 5 selects the images' size.
    """

    kind: str
    family: str
    rig: str
    noise: str
    seed: int

    @property
    def name(self) -> str:
        """As tables and files have it."""
        return f"{self.kind}-{self.rig.rpartition('-')[2]}-{self.noise}"

    @property
    def is_round(self) -> bool:
        """Whether the emission is axisymmetric, or within a few per cent: Abel's case."""
        return self.family in ROUND or self.family == "jet"


@dataclass(frozen=True)
class InBox:
    """An emission given by a function of points, and the grid outside of which it is dark."""

    emission: Callable[[ArrayLike], NDArray]
    grid: VoxelGrid

    @property
    def reach(self) -> tuple[NDArray, NDArray]:
        """The box outside of which there is no light."""
        return self.grid.lower, self.grid.upper

    def __call__(self, points: ArrayLike) -> NDArray[np.float32]:
        """Return the emission ``(...)`` at ``points`` ``(..., 3)``."""
        return self.emission(points).astype(np.float32)


def _shell(radius: NDArray, height: NDArray) -> NDArray:
    """Return a Bunsen flame's cone, its sheet a thirteenth of the grid thick."""
    return np.exp(-0.5 * np.square((radius - 0.38 * (1 - 0.9 * height)) / 0.032))


def _puffs(radius: NDArray, height: NDArray) -> NDArray:
    """Return a jet that widens, with puffs that fade upwards."""
    across = np.exp(-0.5 * np.square(radius / (0.05 + 0.12 * height)))
    return across * (1 + 0.5 * np.cos(25 * height)) / (0.3 + height)


ROUND = {"round shell": _shell, "round puffs": _puffs}
"""Profiles over the radius and, from 0 to 1, the height, both in extents of the grid."""


def _round(profile: Callable, grid: VoxelGrid, points: ArrayLike) -> NDArray:
    x, y, z = np.moveaxis((np.asarray(points) - grid.center) / grid.extent, -1, 0)
    return profile(np.hypot(x, z), y + 0.5) * np.clip((0.47 - np.abs(y)) / 0.08, 0, 1)


SCENES: Mapping[str, Emission] = {
    one.name: one
    for one in (
        Emission("flame", "hollow swirl", "ring-5", "clean", 9000),
        Emission("flame", "turbulent", "dome-8", "poisson", 9000),
        Emission("flame", "round shell", "ring-12", "gaussian", 9005),
        Emission("jet", "round puffs", "ring-8", "clean", 9010),
        Emission("jet", "averaged jet", "half-ring-12", "poisson", 9010),
        Emission("jet", "jet", "ring-24", "gaussian", 9015),
        Emission("smoke", "off-axis plume", "two-level-12", "clean", 9020),
        Emission("smoke", "plume", "ring-24", "poisson", 9020),
        Emission("smoke", "off-axis plume", "dome-5", "gaussian", 9025),
        Emission("sheet", "half-voxel sheets", "dome-24", "clean", 9030),
        Emission("sheet", "smoke sheets", "ring-5", "poisson", 9030),
        Emission("sheet", "fine wrinkles", "two-level-8", "gaussian", 9035),
    )
}
"""Fields and seeds that no rule of the default was settled on, but for the families of smoke
sheets and fine wrinkles, of which other members were."""

QUICK = ("flame-5-clean", "jet-12-poisson", "sheet-8-gaussian")


@dataclass(frozen=True, eq=False)
class Seen:
    """A scene's images and its truth, means of the field over the voxels.

    ``images`` are ``(views, height, width)``, ``truth`` is ``(nx, ny, nz)``; ``held_image``
    ``(height, width)``, without noise, is of the camera ``held``, which judges. All are float32.
    """

    emission: Emission
    grid: VoxelGrid
    rig: Rig
    held: Camera
    images: NDArray[np.float32]
    held_image: NDArray[np.float32]
    truth: NDArray[np.float32]

    @property
    def scan(self) -> Scan:
        """The images as a scan; it knows no truth."""
        taken = dict(zip(self.rig.names, self.images, strict=True))
        return Scan.from_arrays(self.rig, taken, self.grid)

    def scores(self, volume: NDArray[np.float32]) -> dict[str, float]:
        """Return the errors of a volume ``(nx, ny, nz)``: against the truth, and held-out."""
        rig = replace(self.rig, cameras=(self.held,))
        predicted = LinearSystem.from_rig(rig, self.grid, skip=False).projector @ volume.ravel()
        return {
            "nrmse": metrics.nrmse(volume, self.truth),
            "cosine_distance": metrics.cosine_distance(volume, self.truth),
            "ssim": metrics.ssim(volume, self.truth),
            "held_out_psnr": metrics.psnr(predicted, self.held_image.ravel()),
        }


def seen(emission: Emission, cache: Path | None = None, grid: VoxelGrid = GRID) -> Seen:
    """Return a scene, from the folder ``cache`` where it is there; else it is made and kept."""
    rig = cameras.rig(emission.rig, grid, emission.seed)
    other = cameras.rig("dome-7", grid, emission.seed + 5)
    held = replace(other[other.names[4]], name=HELD)
    path = cache / f"{emission.name}-{grid.shape[0]}-{VERSION}.npz" if cache else None
    if path is not None and path.is_file():
        arrays = read_arrays(path)
    else:
        arrays = _taken(emission, grid, rig, held)
        if path is not None:
            with atomic_path(path) as temporary, temporary.open("wb") as file:
                np.savez_compressed(file, **arrays)
    return Seen(emission, grid, rig, held, **arrays)


def _taken(
    emission: Emission, grid: VoxelGrid, rig: Rig, held: Camera
) -> dict[str, NDArray[np.float32]]:
    field = _field(emission, grid)
    *light, held_image = (radiance(camera, field).astype(np.float32) for camera in (*rig, held))
    images = np.stack(with_noise(light, emission.noise, emission.seed)).astype(np.float32)
    truth = phantoms.sample(field, grid, TRUTH_POINTS)
    return {"images": images, "held_image": held_image, "truth": truth}


def _field(emission: Emission, grid: VoxelGrid) -> Field:
    family, seed = emission.family, emission.seed
    if family in FAMILIES:
        return KnownField(family, seed, grid)
    if family in ROUND:
        return InBox(partial(_round, ROUND[family], grid), grid)
    return InBox(phantoms.create(family, seed, grid.extent, grid.center), grid)
