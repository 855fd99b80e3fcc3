"""From a known emission to the images that a rig's cameras would take of it."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from numbers import Integral
from os import PathLike
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from phantoms import Field, sample
from rigs.progress import Progress, progress_of
from tomo.grid import VoxelGrid
from tomo.operators.gpu.names import device_number
from tomo.rays.pixel_rays import rays_of_pixel
from tomo.scan import Corrections, Scan
from tomo.simulation import camera_noise as noises
from tomo.simulation.effects import Effects
from tomo.simulation.project import check_memory, device_of, field_and_grid, project_volumes

if TYPE_CHECKING:
    from xarray import DataArray

    from rigs import Rig

SMALLEST_REFINEMENT = 2
"""Sub-points along a fine voxel's edge for its mean."""


@dataclass(frozen=True, eq=False)
class SimulatedImages:
    """Images of a known volume, and how they came about.

    Attributes
    ----------
    rig : Rig
    images : mapping
        Camera name to float32 ``(h, w)``, in the rig's order.
    grid : VoxelGrid
    truth : (nx, ny, nz) float32
        The means of the field over the voxels of ``grid``.
    settings : mapping
        Every argument of the simulation, the ``gains`` of the cameras where they differ, and the
        ``full_scale`` of quantised images.
    """

    rig: Rig
    images: Mapping[str, NDArray[np.float32]]
    grid: VoxelGrid
    truth: NDArray[np.float32]
    settings: Mapping[str, Any]

    @property
    def scan(self) -> Scan:
        """The scan that these images are, in memory.

        Images quantised to ``bits`` are stored as integers, with ``bit_depth`` and the ``gain``
        that turns them into intensities again among the scan's corrections.
        """
        images: Mapping[str, NDArray] = self.images
        bits, corrections = self.settings.get("bits"), None
        if bits is not None:
            full_scale = self.settings["full_scale"]
            corrections = Corrections(gain=full_scale, bit_depth=bits)
            images = {n: noises.quantise(i, bits, full_scale) for n, i in images.items()}
        effects = self.settings.get("effects")
        if effects is not None and "gains" in self.settings:
            effects = effects | {"gains": self.settings["gains"]}
        return Scan.from_arrays(
            self.rig,
            images,
            self.grid,
            truth=self.truth,
            corrections=corrections,
            effects=effects,
        )

    def save(self, folder: str | PathLike) -> Path:
        """Write the scan as a scan folder of one frame; return its scan.yaml."""
        return self.scan.save(folder)


def simulate(
    rig: Rig, field: Field | DataArray, grid: VoxelGrid | None = None, **settings: Any
) -> Scan:
    """Return the scan that a rig takes of a field, in memory: `Scan.save` writes it.

    Arguments as of `tomo.simulation.simulate_images`.
    """
    return simulate_images(rig, field, grid, **settings).scan


def simulate_images(
    rig: Rig,
    field: Field | DataArray,
    grid: VoxelGrid | None = None,
    *,
    supersample: int = 1,
    refine: int = 1,
    effects: Effects | None = None,
    noise: float = 0.0,
    photons: float | None = None,
    read_noise: float = 0.0,
    bits: int | None = None,
    seed: int = 0,
    tracer: str = "march",
    device: str = "cpu",
    progress: Progress | bool | None = None,
) -> SimulatedImages:
    """Return the images that a rig takes of a field, and how they came about.

    The field is averaged over the voxels of ``grid.refined(refine)`` and projected from there:
    with ``refine`` above 1 and several rays a pixel, a reconstruction on ``grid`` does not invert
    the simulation's own matrix.

    Parameters
    ----------
    rig : Rig
    field : callable or DataArray
        Maps points ``(N, 3)`` to emission ``(N,)``; emission outside the grid is ignored. A
        volume in xarray is the emission of its voxels.
    grid : VoxelGrid, optional
        Where the truth is stored; that of the volume, else the rig's when None.
    supersample : int
        K: K x K rays a pixel; a pixel is the mean of their line integrals.
    refine : int
        How many times finer the projected voxels are.
    effects : Effects, optional
        Effects of gas and cameras on the light; none when None. Noise is added afterwards.
    noise : float
        Standard deviation of white noise, as a fraction of the maximum of all images.
    photons : float, optional
        Photons detected in the brightest pixel; photon noise is added when given.
    read_noise : float
        Electrons of read-out noise; only with ``photons``.
    bits : int, optional
        Quantise to integers of this many bits; full scale is the maximum of all images.
    seed : int
        Seed of noise and gains; equal seeds give bit-identical images.
    tracer : str
        See `tomo.trace`.
    device : str
        Where rays are projected: ``cpu``, ``auto``, ``cuda`` or ``cuda:N``. On a device the tracer
        is not used.
    progress : bool or callable, optional
        True shows a bar; called with the pixels done, their total, and the camera's name.

    Raises
    ------
    ValueError
        If an argument is out of range, no camera sees the grid, or a device that is asked for by
        name cannot be used.
    """
    check(supersample, noise, photons, read_noise, bits, seed)
    device_number(device)
    field, grid = field_and_grid(field, grid, rig)
    effects = Effects() if effects is None else effects
    fine_grid = grid.refined(refine)
    check_memory(fine_grid)
    there, place = device_of(device, rig, grid, fine_grid, effects, supersample)
    gains = effects.gains(len(rig), seed)
    fine = sample(field, fine_grid, SMALLEST_REFINEMENT)  # (nx R, ny R, nz R)
    with progress_of(progress, "simulate") as tell:
        (images,) = project_volumes(
            rig, [fine], grid, fine_grid, effects, gains, supersample, tracer, tell, there
        )

    settings: dict[str, Any] = {
        "field": repr(field),
        "supersample": supersample,
        "refine": refine,
        "effects": asdict(effects) if effects.any else None,
        "noise": noise,
        "photons": photons,
        "read_noise": read_noise,
        "bits": bits,
        "seed": seed,
        "tracer": tracer,
        "device": place,
    }
    if effects.gain_spread > 0:
        settings["gains"] = dict(zip(rig.names, gains.tolist(), strict=True))
    random = np.random.default_rng(seed)
    recorded = noises.noisy(list(images.values()), random, noise, photons, read_noise)
    if bits is not None:
        full_scale = max(float(image.max()) for image in recorded)
        if full_scale <= 0:
            raise ValueError("bits: found only dark images, expected a maximum to quantise by")
        settings["full_scale"] = full_scale
        integers = noises.quantise(recorded, bits, full_scale)
        recorded = noises.dequantise(integers, bits, full_scale)
    truth = grid.average(fine, refine)
    return SimulatedImages(
        rig,
        MappingProxyType(dict(zip(images, recorded, strict=True))),
        grid,
        truth,
        MappingProxyType(settings),
    )


def check(
    supersample: int,
    noise: float,
    photons: float | None,
    read_noise: float,
    bits: int | None,
    seed: int,
) -> None:
    """Check the arguments before any ray is traced."""
    rays_of_pixel(supersample)
    if not isinstance(seed, Integral) or seed < 0:
        raise ValueError(f"seed: found {seed!r}, expected a whole number >= 0")
    if not (math.isfinite(noise) and noise >= 0):
        raise ValueError(f"noise: found {noise}, expected a fraction >= 0")
    if photons is not None and not (math.isfinite(photons) and photons > 0):
        raise ValueError(f"photons: found {photons}, expected a number > 0")
    if not (math.isfinite(read_noise) and read_noise >= 0):
        raise ValueError(f"read_noise: found {read_noise}, expected electrons >= 0")
    if read_noise and photons is None:
        raise ValueError("read_noise: found it without photons, expected both or none")
    if bits is not None and bits not in range(1, 17):
        raise ValueError(f"bits: found {bits}, expected a whole number from 1 to 16")
