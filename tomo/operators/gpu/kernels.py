"""The text of the kernels, for whichever compiler: CUDA's at run time, the host's in tests."""

from __future__ import annotations

from collections.abc import Iterator
from importlib.resources import files

import numpy as np
from numpy.typing import DTypeLike

FILES = ("walk.cu", "projection.cu", "blur.cu")

NAMES = (
    "forward_1", "forward_4", "dimmed_forward", "adjoint_1", "adjoint_4", "dimmed_adjoint",
    "largest", "spread", "collect", "row_parts_1", "row_parts_4", "row_totals", "blurred",
)  # fmt: skip
"""The kernels that are launched by name."""


TOGETHER = 4
"""Columns that share a walk, or the reading of an entry."""


def together(columns: int, most: int = TOGETHER) -> Iterator[tuple[int, int]]:
    """Iterate over columns computed together: the first, and how many, ``most`` or 1."""
    first = 0
    while first < columns:
        some = most if first + most <= columns else 1
        yield first, some
        first += some


def source(values: DTypeLike) -> str:
    """Return the whole text for volumes and images of one type, float32 or float64."""
    real = {np.dtype(np.float32): "float", np.dtype(np.float64): "double"}[np.dtype(values)]
    folder = files("tomo.operators.gpu")
    parts = [folder.joinpath(name).read_text("utf-8") for name in FILES]
    return "\n".join([f"typedef {real} real;", *parts])
