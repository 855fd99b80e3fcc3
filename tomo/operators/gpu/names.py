"""The names of devices: ``cpu``, ``auto``, ``cuda`` and ``cuda:N``."""

from __future__ import annotations

import re

CPU, AUTO, CUDA = "cpu", "auto", "cuda"
DEVICES = "cpu, auto, cuda or cuda:N"
ON_CPU = "computed on the CPU"


def device_number(name: str) -> int | None:
    """Return the number of the CUDA device that is asked for; None for ``cpu`` and ``auto``.

    >>> device_number("cuda"), device_number("cuda:1"), device_number("cpu")
    (0, 1, None)
    """
    match = re.fullmatch(r"cuda(?::(\d{1,3}))?", name, re.ASCII)
    if match is None and name not in (CPU, AUTO):
        raise ValueError(f"device: found {name!r}, expected {DEVICES}")
    return None if match is None else int(match[1] or 0)


def settled(name: str, place: str) -> str:
    """Return the name by which what ``auto`` chose is asked for again.

    >>> settled("auto", "computed on a device (cuda:0)"), settled("auto", ON_CPU)
    ('cuda', 'cpu')
    """
    if ON_CPU in place:
        return CPU
    return CUDA if name == AUTO else name
