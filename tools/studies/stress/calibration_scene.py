"""A small flame, and rigs that are wrong about the cameras that saw it."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import replace
from types import MappingProxyType

import cv2
import numpy as np

import rigs
from rigs import Camera, Distortion
from studies.common.scans import simulated_by
from tomo import Scan
from tomo.grid import VoxelGrid
from tomo.simulation.camera_noise import gaussian
from tomo.simulation.simulate import SimulatedImages

GRID = VoxelGrid((20, 40, 20), 0.5)
VIEWS = 12
FOOTPRINT = 0.25  # size of a pixel in the middle of the flame
Wrong = Callable[[Camera, float, np.random.Generator], Camera]


def turned(camera: Camera, pixels: float, random: np.random.Generator) -> Camera:
    """Turn a camera where it stands, so that its image moves by so many pixels."""
    direction = random.uniform(0, 2 * np.pi)
    angle = pixels / camera.camera_matrix[0, 0]
    axis = angle * np.array([np.cos(direction), np.sin(direction), 0.0])
    turn = cv2.Rodrigues(axis)[0]
    return replace(camera, R=turn @ camera.R, t=turn @ camera.t)


def zoomed(camera: Camera, pixels: float, random: np.random.Generator) -> Camera:
    """Change a camera's focal length: along the flame things move by so many pixels r.m.s."""
    matrix = np.array(camera.camera_matrix)
    ends = np.sqrt(3) * pixels  # where the displacement grows with the distance
    matrix[[0, 1], [0, 1]] *= 1 + random.choice([-1, 1]) * ends / _to_the_ends(camera)
    return replace(camera, camera_matrix=matrix)


def bent(camera: Camera, pixels: float, random: np.random.Generator) -> Camera:
    """Give a lens distortion: along the flame things move by so many pixels r.m.s."""
    radius = _to_the_ends(camera) / camera.camera_matrix[0, 0]
    ends = np.sqrt(7) * pixels  # where the displacement grows with the distance cubed
    k1 = random.choice([-1, 1]) * ends / _to_the_ends(camera) / radius**2
    return replace(camera, distortion=Distortion("brown", (k1, 0, 0, 0)))


def slipped(camera: Camera, pixels: float, random: np.random.Generator) -> Camera:
    """Count pixels from their corners, or the like: right and down by as much in all cameras."""
    # down is a motion of the flame, which no image contradicts: it is right that counts
    return camera.shifted(pixels, pixels)


KINDS: MappingProxyType[str, Wrong] = MappingProxyType(
    {"pose": turned, "focal length": zoomed, "distortion": bent, "half-pixel slip": slipped}
)


def _to_the_ends(camera: Camera) -> float:
    """Return how far the flame's ends are from the middle of the image, in pixels."""
    return float(camera.camera_matrix[1, 1] * GRID.extent[1] / 2 / np.linalg.norm(camera.position))


def seen_wrongly(made: SimulatedImages, kind: str, pixels: float, seed: int = 0) -> Scan:
    """Return the scan with a rig that is off by so many pixels, in each camera anew."""
    random = np.random.default_rng([seed, list(KINDS).index(kind)])
    return _seen_by(made, (KINDS[kind](camera, pixels, random) for camera in made.rig))


def one_off(made: SimulatedImages, number: int, pixels: float) -> Scan:
    """Return the scan with a rig of which one camera is off by so many pixels."""
    cameras = list(made.rig)
    cameras[number] = turned(cameras[number], pixels, np.random.default_rng(number))
    return _seen_by(made, cameras)


def _seen_by(made: SimulatedImages, cameras: Iterable[Camera]) -> Scan:
    return replace(made.scan, rig=replace(made.rig, cameras=tuple(cameras)))


def simulated(seed: int = 0) -> SimulatedImages:
    """Simulate a turbulent flame: voxels twice as fine, 3 x 3 rays a pixel."""
    rig = rigs.ring(
        VIEWS, distance=300.0, image_size=(56, 88), footprint=FOOTPRINT, pitch_degrees=10.0
    )
    return simulated_by(rig, GRID, ("turbulent", seed), supersample=3, seed=seed)


def noisier(made: SimulatedImages, noise: float, seed: int) -> SimulatedImages:
    """Return it with noise, as `simulate` adds it: a fraction of the maximum of all images."""
    recorded = gaussian(list(made.images.values()), noise, np.random.default_rng(seed))
    return replace(made, images=MappingProxyType(dict(zip(made.images, recorded, strict=True))))
