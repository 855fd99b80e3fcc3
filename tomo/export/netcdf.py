"""NetCDF-4 after the CF conventions: time, x, y and z with units, and the figures of frames."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from rigs.files import atomic_path
from tomo.export.frames import Frames
from tomo.series.layout import CAMERA_FIGURES, FIGURES


def write_netcdf(frames: Frames, target: Path) -> None:
    """Write one file; a chunk a frame, compressed."""
    import h5netcdf

    store = frames.store
    cameras = store.attributes["cameras"]
    sizes = dict(zip(("time", "x", "y", "z"), (len(frames), *store.grid.shape), strict=True))
    with atomic_path(target) as temporary, h5netcdf.File(temporary, "w") as file:
        file.attrs.update(frames.about())
        file.dimensions = sizes | {"camera": len(cameras)}

        def variable(name, dims, values, **attributes):
            made = file.create_variable(name, dims, data=values)
            made.attrs.update(attributes)

        for name in "xyz":
            centres, unit = frames.axis(name)
            variable(name, (name,), centres, units=unit, axis=name.upper())
        variable("time", ("time",), frames.times, units=store.attributes["time_unit"], axis="T")
        variable("frame", ("time",), frames.numbers, long_name="number in the scan")
        width = max(len(name.encode()) for name in cameras)
        variable("camera", ("camera",), np.array([name.encode() for name in cameras], f"S{width}"))
        for names, dims in ((FIGURES, ("time",)), (CAMERA_FIGURES, ("time", "camera"))):
            for name in names:
                variable(name, dims, frames.of(name), units=store.unit(name))
        data = file.create_variable(
            "emission",
            tuple(sizes),
            "f4",
            fillvalue=np.float32(np.nan),
            chunks=(1, *frames.chunk()),
            compression="gzip",
            compression_opts=1,
        )
        data.attrs.update(
            units=store.attributes["value_unit"], long_name="mean emission of a voxel"
        )
        for step, volume in enumerate(frames.volumes()):
            data[step] = volume
