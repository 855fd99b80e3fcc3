"""Two files of HDF5: NetCDF-4 after the CF conventions, and VTKHDF for VTK 9.3, ParaView 5.12 on.

VTKHDF is written by the published layout,
https://docs.vtk.org/en/latest/design_documents/VTKFileFormats.html: a group ``VTKHDF`` with a
version, a type and the grid, point data with the frames along its first axis, and ``Steps`` with
the times. As in .vti, values stand at points, which are voxel centres.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from rigs.files import atomic_path
from tomo.export.export import LARGEST_CHUNK, Frames
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


ARRAY = "emission"


def write_vtkhdf(frames: Frames, target: Path) -> None:
    """Write one file; a chunk a frame, compressed."""
    import h5py

    grid = frames.store.grid
    nx, ny, nz = grid.shape
    with atomic_path(target) as temporary, h5py.File(temporary, "w") as file:
        root = file.create_group("VTKHDF")
        root.attrs.create("Type", np.bytes_("ImageData"))  # of fixed length, as the layout asks
        for name, values, dtype in (
            ("Version", (2, 2), "i8"),
            ("WholeExtent", (0, nx - 1, 0, ny - 1, 0, nz - 1), "i8"),
            ("Origin", grid.origin, "f8"),
            ("Spacing", grid.spacing, "f8"),
            ("Direction", np.eye(3).ravel(), "f8"),
        ):
            root.attrs.create(name, np.array(values, dtype))
        points = root.create_group("PointData")
        points.attrs["Scalars"] = np.bytes_(ARRAY)
        data = points.create_dataset(
            ARRAY,
            (len(frames), nz, ny, nx),
            "f4",
            chunks=(1, *_planes(frames), nx),
            compression="gzip",
            compression_opts=1,
        )
        data.attrs["units"] = frames.store.attributes["value_unit"]
        root.attrs["length_unit"] = frames.store.attributes["length_unit"]
        steps = root.create_group("Steps")
        steps.attrs["NSteps"] = np.int64(len(frames))
        steps["Values"] = frames.times
        steps[f"PointDataOffsets/{ARRAY}"] = np.arange(len(frames), dtype=np.int64)
        for step, volume in enumerate(frames.volumes()):
            data[step] = volume.T  # x runs fastest


def _planes(frames: Frames) -> tuple[int, int]:
    """Return how many planes of z, each whole, a chunk holds."""
    nx, ny, nz = frames.store.grid.shape
    return min(nz, max(LARGEST_CHUNK // (4 * nx * ny), 1)), ny
