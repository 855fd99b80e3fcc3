"""The device that a network is trained on, and the optimiser that suits it."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import torch


def usable_device(device: str | torch.device) -> torch.device:
    """Return the device, once a tensor has been made on it.

    Raises
    ------
    ValueError
        If PyTorch cannot use such a device here.
    """
    try:
        found = torch.device(device)
        torch.zeros(1, device=found).item()
    except (RuntimeError, AssertionError, NotImplementedError) as error:
        raise ValueError(
            f"device: found {str(device)!r}, expected one that this PyTorch can use "
            f"(cpu, cuda, mps): {str(error).splitlines()[0]}"
        ) from error
    return found


def adam(groups: Iterable[dict[str, Any]], device: torch.device) -> torch.optim.Adam:
    """Return Adam over groups of parameters on a device.

    On CUDA the fused form is used: starting its operations one by one takes longer than they do.
    """
    return torch.optim.Adam(groups, fused=device.type == "cuda")
