"""Where tensors active, and what is done differently there."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import torch


def usable_device(device: str | torch.device) -> torch.device:
    """Return the device, once a tensor has been made on it.

    Raises
    ------
    ValueError
        If there is no such device here.
    """
    try:
        place = torch.device(device)
        torch.zeros(1, device=place).item()
    except (RuntimeError, AssertionError, NotImplementedError) as error:
        raise ValueError(
            f"device: found {str(device)!r}, expected one that this PyTorch can use "
            f"(cpu, cuda, mps): {str(error).splitlines()[0]}"
        ) from error
    return place


def adam(groups: Iterable[dict[str, Any]], device: torch.device) -> torch.optim.Adam:
    """Return Adam over parameters on a device.

    On CUDA it takes a step all at once: to send each of its operations there takes longer than to
    do it.
    """
    return torch.optim.Adam(groups, fused=device.type == "cuda")
