"""VTKHDF: one HDF5 file of image data that changes with time, for VTK 9.3 and ParaView 5.12 on.

Written by the published layout, https://docs.vtk.org/en/latest/design_documents/VTKFileFormats.html:
a group ``VTKHDF`` with a version, a type and the grid, point data with the frames along its first
axis, and ``Steps`` with the times. As in .vti, values stand at points, which are voxel centres.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from rigs.files import atomic_path
from tomo.export.frames import LARGEST_CHUNK, Frames

VERSION = (2, 2)
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
            ("Version", VERSION, "i8"),
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
