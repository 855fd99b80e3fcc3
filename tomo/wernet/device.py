"""Where tensors live."""

from __future__ import annotations

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
