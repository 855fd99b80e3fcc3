"""From an emission to images of it without noise: traced once for several volumes."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from functools import partial
from typing import TYPE_CHECKING, cast

import numpy as np
from numpy.typing import NDArray

from phantoms import Field, SampledField
from tomo._compute.memory import available_memory
from tomo.grid import ActiveVoxels, VoxelGrid, grid_of_rig
from tomo.io.xarray_volumes import volume_of_data_array
from tomo.operators import Absorption, Projector, extinction_of
from tomo.operators.gpu import DeviceProjector, taken_to, to_device
from tomo.operators.gpu.names import CPU, ON_CPU
from tomo.operators.gpu.probe import PROBED
from tomo.operators.on_the_fly import AttenuatedProjector, OnTheFlyProjector
from tomo.operators.operator import ProjectionOperator
from tomo.operators.spmv import product
from tomo.rays import Rays
from tomo.simulation.effects import Effects

if TYPE_CHECKING:
    from xarray import DataArray

    from rigs import Rig
    from rigs.progress import Progress
    from tomo.operators.gpu import Device


def field_and_grid(
    field: Field | DataArray, grid: VoxelGrid | None, rig: Rig
) -> tuple[Field, VoxelGrid]:
    """Return the field of an emission, and the grid: the given, its own or the rig's."""
    own = None
    if hasattr(field, "dims"):
        volume = volume_of_data_array(cast("DataArray", field))
        if volume.length_unit != rig.length_unit:
            raise ValueError(
                f"field: length unit: found {volume.length_unit!r}, expected {rig.length_unit!r}, "
                "the rig's"
            )
        own, field = volume.grid, SampledField(volume, volume.grid)
    grid = grid or own or grid_of_rig(rig)
    if grid is None:
        raise ValueError(
            "grid: found none, expected a VoxelGrid, as the rig does not say where the volume is"
        )
    return cast("Field", field), grid


_SEGMENTS_AT_ONCE = 8_000_000  # 100 MiB of segments, 300 with absorption, for any image size
_RAYS_AT_ONCE = 2**19
_BYTES_PER_VOXEL = 12  # the volume, and the double-precision means of the truth


def project_volumes(
    rig: Rig,
    volumes: Sequence[NDArray[np.float32]],
    grid: VoxelGrid,
    fine_grid: VoxelGrid,
    effects: Effects,
    gains: NDArray[np.float64],
    supersample: int,
    tracer: str,
    progress: Progress | None = None,
    device: Device | None = None,
) -> list[dict[str, NDArray[np.float32]]]:
    """Return the images of some volumes, camera name to ``(h, w)``, one mapping a volume.

    Rays are traced once for all volumes ``(nx, ny, nz)`` on ``fine_grid``, unless the gas absorbs
    its own light. On a ``device`` they are projected by face crossings whatever the tracer.
    """
    seen = {camera.name: effects.pixels_that_see(camera, grid) for camera in rig}
    total = sum(len(pixels) for pixels in seen.values())
    if not total:
        raise ValueError(
            f"rig: found no camera that sees the grid from {grid.lower.tolist()} to "
            f"{grid.upper.tolist()}, expected at least one"
        )
    gas = extinction_of(rig)
    every = ActiveVoxels(fine_grid)
    # once for all pixels: with fine voxels this takes longer than the product with some pixels
    ready = [every.to_storage(one.ravel()) if device is None else one.ravel() for one in volumes]
    found: list[dict[str, NDArray[np.float32]]] = [{} for _ in volumes]
    done = 0
    for camera, gain in zip(rig, gains, strict=True):
        width, height = camera.image_size
        flat = np.zeros((len(volumes), width * height), np.float32)
        for pixels in _chunks(seen[camera.name], fine_grid, effects.rays_per_pixel(supersample)):
            rays = effects.rays(camera, pixels, supersample)
            centres = np.stack([pixels % width, pixels // width], axis=-1)
            light = gain * effects.falloff(camera, centres)  # 1 where there is neither
            project: Callable[[NDArray], NDArray] | None = None
            for volume, values, image in zip(volumes, ready, flat, strict=True):
                if project is None or effects.self_absorption:
                    if device is None:
                        segments = effects.trace(rays, fine_grid, volume, tracer, gas)
                        projector = Projector(segments, fine_grid, active=every)
                        project = partial(product, projector.matrix, entries=len(segments))
                    else:
                        moved = _on_device(rays, every, effects.gas(gas), volume, device)
                        project = moved.matvec
                image[pixels] = project(values) * light
            done += len(pixels)
            if progress is not None:
                progress(done, total, camera.name)
        for images, image in zip(found, flat, strict=True):
            images[camera.name] = image.reshape(height, width)
    return found


def _on_device(
    rays: Rays,
    every: ActiveVoxels,
    absorption: Absorption,
    volume: NDArray[np.float32],
    device: Device,
) -> ProjectionOperator:
    """Return the projection of some rays on a device, through gas where that absorbs."""
    flying = OnTheFlyProjector(rays, every.grid, active=every)
    if not absorption:
        return to_device(flying, device)
    return to_device(AttenuatedProjector(flying, absorption, volume.ravel()), device)


def device_of(
    name: str, rig: Rig, grid: VoxelGrid, fine_grid: VoxelGrid, effects: Effects, supersample: int
) -> tuple[Device | None, str]:
    """Return the device that a simulation is to be computed on, probed; or None, and why."""
    if name == CPU:
        return None, ON_CPU
    seen = {camera.name: effects.pixels_that_see(camera, grid) for camera in rig}
    rays = effects.rays_per_pixel(supersample) * sum(map(len, seen.values()))
    camera = max(rig, key=lambda one: len(seen[one.name]))
    some = seen[camera.name][:: max(len(seen[camera.name]) // PROBED, 1)]
    flying = OnTheFlyProjector(effects.rays(camera, some, supersample), fine_grid)
    moved, place = taken_to(flying, name, float(rays) * sum(fine_grid.shape))
    return moved.device if isinstance(moved, DeviceProjector) else None, place


def check_memory(fine_grid: VoxelGrid) -> None:
    """Refuse voxels that the memory cannot hold, before anything is allocated.

    Raises
    ------
    ValueError
        With the grid that would fit.
    """
    needed, available = _BYTES_PER_VOXEL * fine_grid.size, available_memory()
    if needed > available:
        shrink = (0.8 * available / needed) ** (1 / 3)
        shape, fits = (
            "x".join(str(n) for n in counts)
            for counts in (fine_grid.shape, (max(int(n * shrink), 1) for n in fine_grid.shape))
        )
        raise ValueError(
            f"grid {shape}, refinement included: would take about {needed / 1e9:,.1f} GB, found "
            f"{available / 1e9:,.1f} GB free; {fits} voxels would fit"
        )


def volumes_at_once(fine_grid: VoxelGrid, most: int) -> int:
    """Return how many volumes fit into a quarter of the free memory: 1 to ``most``."""
    room = available_memory() / 4 / (_BYTES_PER_VOXEL * fine_grid.size)
    return int(min(max(room, 1), most))


def _chunks(pixels: NDArray, grid: VoxelGrid, rays_per_pixel: int) -> Iterator[NDArray]:
    """Cut ``pixels`` into chunks whose rays cross a bounded number of voxels."""
    rays = min(_SEGMENTS_AT_ONCE // sum(grid.shape), _RAYS_AT_ONCE)
    size = max(1, rays // rays_per_pixel)
    for start in range(0, len(pixels), size):
        yield pixels[start : start + size]
