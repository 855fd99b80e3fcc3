"""Films of moving fields: frames simulated one after the other, straight onto disk."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from phantoms import Field, field_at, sample
from rigs.progress import Progress, progress_of
from tomo.grid import VoxelGrid
from tomo.operators.gpu.names import device_number
from tomo.scan import Corrections
from tomo.scan.write import writing_film
from tomo.simulation import camera_noise as noises
from tomo.simulation.effects import Effects
from tomo.simulation.project import (
    check_memory,
    device_of,
    field_and_grid,
    project_volumes,
    volumes_at_once,
)
from tomo.simulation.simulate import SMALLEST_REFINEMENT, check

if TYPE_CHECKING:
    from os import PathLike

    from xarray import DataArray

    from rigs import Rig

FRAME_RATE = 10_000.0
"""Frames a second, as of high-speed cameras: a flame of 4 m/s moves by 0.4 mm in one."""

HEADROOM = 1.25
"""Full scale of quantised films over the brightest pixel of the frames that exposure is set by:
frames between them may be brighter. More wastes grey levels, less saturates pixels."""

_METERED = 4  # frames, spread over the film, that exposure is set by
_AT_ONCE = 8  # volumes that share a tracing: more gain nothing


def simulate_film(
    rig: Rig,
    field: Field | DataArray,
    grid: VoxelGrid | None,
    folder: str | PathLike,
    *,
    frames: int,
    frame_rate: float = FRAME_RATE,
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
) -> Path:
    """Write the film that a rig takes of a field as a scan folder; return its scan.yaml.

    Frame ``n`` shows the field at ``n / frame_rate`` seconds (`phantoms.field_at`). The folder
    appears when all is done; the memory does not depend on the number of frames. Parameters and
    errors are those of `tomo.simulation.simulate_images`, but for:

    Parameters
    ----------
    frames : int
    frame_rate : float
        Frames a second.
    noise, photons, read_noise, bits
        The maximum is that of four frames spread over the film: its exposure does not change.
        Full scale is a quarter above it, and brighter pixels are saturated.
    seed : int
        Noise is that of the seed and the frame's number: independent from frame to frame.
    progress : bool or callable, optional
        True shows a bar; called with the frames done, their total, and the step.
    """
    check(supersample, noise, photons, read_noise, bits, seed)
    device_number(device)
    if frames < 1 or frames != int(frames):
        raise ValueError(f"frames: found {frames}, expected a whole number >= 1")
    if not (math.isfinite(frame_rate) and frame_rate > 0):
        raise ValueError(f"frame_rate: found {frame_rate}, expected frames a second, > 0")
    field, grid = field_and_grid(field, grid, rig)
    effects = Effects() if effects is None else effects
    fine_grid = grid.refined(refine)
    check_memory(fine_grid)
    there, _ = device_of(device, rig, grid, fine_grid, effects, supersample)
    gains = effects.gains(len(rig), seed)

    def images_of(numbers: range | list[int]) -> tuple[list[dict[str, NDArray]], list[NDArray]]:
        """Return the images without noise and the truths of some frames."""
        fine = [
            sample(field_at(field, number / frame_rate), fine_grid, SMALLEST_REFINEMENT)
            for number in numbers
        ]
        found = project_volumes(
            rig, fine, grid, fine_grid, effects, gains, supersample, tracer, None, there
        )
        return found, [grid.average(volume, refine) for volume in fine]

    maximum = 0.0
    if noise or photons is not None or bits is not None:
        metered = {(frames - 1) * part // max(_METERED - 1, 1) for part in range(_METERED)}
        with progress_of(progress, "exposure") as tell:
            for done, number in enumerate(metered):
                if tell:
                    tell(done, len(metered), f"frame {number}")
                (images,), _ = images_of([number])
                maximum = max(maximum, *(float(image.max()) for image in images.values()))
        if maximum == 0:
            raise ValueError("noise: found only dark frames, expected a maximum to scale it by")
    full_scale = HEADROOM * maximum

    def recorded(number: int, images: Mapping[str, NDArray]) -> dict[str, NDArray]:
        random = np.random.default_rng((seed, number))
        found: Sequence[NDArray] = list(images.values())
        found = noises.noisy(found, random, noise, photons, read_noise, maximum=maximum)
        if bits is not None:
            found = noises.quantise(found, bits, full_scale)
        return dict(zip(images, found, strict=True))

    about = None
    if effects.any:
        about = vars(effects) | {"gains": dict(zip(rig.names, gains.tolist(), strict=True))}
    corrections = None if bits is None else Corrections(gain=full_scale, bit_depth=bits)
    dtype = np.float32 if bits is None else np.uint8 if bits <= 8 else np.uint16
    at_once = volumes_at_once(fine_grid, _AT_ONCE)
    with progress_of(progress, "simulate") as tell, writing_film(
        folder, rig, grid, frames=int(frames), frame_rate=float(frame_rate), dtype=dtype,
        corrections=corrections, effects=about,
    ) as put:  # fmt: skip
        for start in range(0, frames, at_once):
            numbers = range(start, min(start + at_once, frames))
            if tell:
                tell(start, frames, f"frame {start}")
            for number, images, truth in zip(numbers, *images_of(numbers), strict=True):
                put(recorded(number, images), truth)
        if tell:
            tell(frames, frames, "")
    return Path(folder) / "scan.yaml"
