"""Mean and RMS of the fluctuation of every voxel, in one pass over the frames."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import zarr

from rigs.files import atomic_path
from tomo.export.frames import Frames
from tomo.grid import mean_and_rms
from tomo.io.checked_arrays import create_array


def write_statistics(frames: Frames, target: Path) -> None:
    """Write ``mean`` and ``rms`` of the frames into a Zarr group that xarray reads.

    Raises
    ------
    ValueError
        If there is one frame alone.
    FileExistsError
        If there is something at ``target``.
    """
    if len(frames) < 2:
        raise ValueError(
            f"{frames.store.path}: frames: found 1, expected 2 or more for statistics"
        )
    with result_store(frames, target) as group:
        mean, rms = mean_and_rms(frames.volumes())
        unit = frames.store.attributes["value_unit"]
        for name, values, words in (
            ("mean", mean, "mean over time"),
            ("rms", rms, "root mean square of the fluctuation about the mean"),
        ):
            create_array(
                group, name, values.shape, frames.chunk(), "f4", ("x", "y", "z"),
                units=unit, long_name=f"{words} of a voxel's emission",
            )[:] = values.astype(np.float32)  # fmt: skip


@contextmanager
def result_store(frames: Frames, target: Path, **attributes: Any) -> Iterator[zarr.Group]:
    """Yield a new Zarr group with coordinates, which appears at ``target`` whole or not at all."""
    if target.exists():
        raise FileExistsError(f"{target}: is there already, expected the name of a new store")
    with atomic_path(target) as temporary:
        group = zarr.create_group(
            temporary,
            zarr_format=3,
            attributes={
                **frames.about(),
                "store": frames.store.path.name,
                "frames": frames.numbers.tolist(),
                "grid": frames.store.grid.to_mapping(),
                "length_unit": frames.store.attributes["length_unit"],
                **attributes,
            },
        )
        for name in "xyz":
            centres, unit = frames.axis(name)
            shape = centres.shape
            create_array(group, name, shape, shape, "f8", (name,), units=unit)[:] = centres
        yield group
