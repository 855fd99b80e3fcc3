"""The device that an option names, or the CPU and why."""

from __future__ import annotations

import logging

import numpy as np

from tomo.operators.gpu.device import CudaDevice, DeviceError
from tomo.operators.gpu.device_operator import DeviceOperator
from tomo.operators.gpu.names import AUTO, CPU, ON_CPU, device_number
from tomo.operators.gpu.probe import on_device, rays_of
from tomo.operators.gpu.slabs import DeviceSlabs
from tomo.operators.operator import ProjectionOperator

WORTH = 5e9
"""Segments times iterations from which ``auto`` takes a device: two cores of a CPU compute them in
about 4 s, as long as CuPy may take to load, to compile and to copy rays. Below, a device's start
takes longer than it saves; far above, films and fine grids would stay on the CPU. Not measured."""

logger = logging.getLogger(__name__)


def device_for(name: str, work: float) -> tuple[CudaDevice | None, str]:
    """Return the device that is asked for and where that is; or None, and why.

    ``auto`` takes the first device where there is one and the ``work``, segments times iterations,
    is worth it. ValueError, in one line: one that is asked for by name cannot be used.
    """
    number = device_number(name)
    if name == CPU:
        return None, ON_CPU
    if name == AUTO and work < WORTH:
        return None, _said(f"{work:.1e} segments times iterations, a GPU pays from {WORTH:.0e}")
    try:
        device = CudaDevice(number or 0)
        device.compile(np.float32)
    except DeviceError as error:
        if name == AUTO:
            return None, _said(str(error))
        raise ValueError(_refused(name, str(error))) from None
    return device, f"computed on {device.name}"


def device_count(name: str) -> int:
    """Return how many devices there are, where one is asked for by ``name``; ValueError: none."""
    try:
        return CudaDevice().count
    except DeviceError as error:
        raise ValueError(_refused(name, str(error))) from None


def taken_to(
    operator: ProjectionOperator, name: str, work: float
) -> tuple[ProjectionOperator, str]:
    """Return the same operator on the device that is asked for, or itself, and where that is.

    As `device_for`; one that is asked for by name may also have too little memory, or compute
    something else than the CPU.
    """
    device, place = device_for(name, work)
    if device is None:
        return operator, place
    moved, place = on_device(operator, device)
    if moved is operator:
        reason = place.removesuffix(f": {ON_CPU}")
        if name != AUTO:
            raise ValueError(_refused(name, reason))
        return operator, _said(reason)
    return moved, place


def on_cpu(operator: ProjectionOperator) -> ProjectionOperator:
    """Return the operator that was taken to a device; one of the CPU as it is."""
    if isinstance(operator, DeviceOperator | DeviceSlabs):
        return operator.on_cpu
    if isinstance(rays_of(operator), DeviceSlabs):
        return operator.with_rays(on_cpu)
    return operator


def _refused(name: str, reason: str) -> str:
    return f"device: found {name!r}, expected one that can be used: {reason}"


def _said(reason: str) -> str:
    logger.info("%s: %s", reason, ON_CPU)
    return f"{reason}: {ON_CPU}"
