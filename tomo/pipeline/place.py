"""Where products are computed: the one place at which equations go to a device."""

from __future__ import annotations

import math
from dataclasses import replace

from rigs import Rig
from tomo.grid import VoxelGrid
from tomo.operators import LinearSystem
from tomo.operators.gpu import device_for, taken_to
from tomo.operators.gpu.device import Device
from tomo.operators.gpu.names import AUTO, CPU, CUDA, ON_CPU, device_number
from tomo.operators.memory import estimate_memory
from tomo.pipeline.methods import Method, method_named
from tomo.pipeline.options import Options


def check_device(device: str, methods: list[Method]) -> None:
    """Refuse a device that is asked for by name and that cannot be used."""
    if device_number(device) is None:
        return
    trains = any(method.takes("device") for method in methods)
    if trains:
        from tomo.wernet import usable_device

        usable_device(device)
    if not _through_entries(methods):
        device_for(device, math.inf)
    elif not trains:
        raise ValueError(
            f"device: found {device!r}, expected {CPU} or {AUTO} for method "
            f"{_through_entries(methods)}: it goes through the matrix's entries one by one"
        )


def at_device(
    system: LinearSystem, options: Options, methods: list[Method]
) -> tuple[LinearSystem, str]:
    """Return the equations where products are wanted, and where: the CPU if entries are needed."""
    if options.device == CPU:
        return system, ON_CPU
    if name := _through_entries(methods):
        return system, f"{name} goes through the matrix's entries: {ON_CPU}"
    work = math.inf  # the frames of a film
    if options.frames is None:
        work = float(system.projector.n_segments) * _iterations(options)
    projector, place = taken_to(system.projector, options.device, work)
    return replace(system, projector=projector), place


def device_of_inference(
    rig: Rig, grid: VoxelGrid, options: Options, methods: list[Method]
) -> Device | None:
    """Return the equations' device, by estimated segments, to find effects on; None: the CPU."""
    if options.device == CPU or _through_entries(methods):
        return None
    work = math.inf
    if options.device == AUTO and options.frames is None:
        work = float(estimate_memory(tuple(rig), grid).segments) * _iterations(options)
    return device_for(options.device, work)[0]


def training_device(device: str) -> str:
    """Return the device that PyTorch trains on; ``auto`` is a CUDA device where it finds one."""
    if device != AUTO:
        return device
    import torch

    return CUDA if torch.cuda.is_available() else CPU


def _through_entries(methods: list[Method]) -> str:
    """Return the first method that goes through the matrix's entries; nothing where none does."""
    return next((method.name for method in methods if method.needs_matrix), "")


def _iterations(options: Options) -> int:
    """Return about how many iterations are run."""
    from tomo.selection.fits import CHECKPOINTS

    method = method_named(options.method)
    most = CHECKPOINTS[-1] if method.name == AUTO else method.default_iterations
    return most if options.iterations is None else options.iterations
