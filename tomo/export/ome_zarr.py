"""OME-Zarr 0.5: a film with axes, units and the place of its voxels, for napari and Fiji.

Written by the published layout, https://ngff.openmicroscopy.org/0.5/: a Zarr v3 group whose
attribute ``ome`` names the axes ``t, z, y, x`` and, for the one resolution, the scale and the
translation from array indices to the world. Both are of voxel centres.
"""

from __future__ import annotations

from pathlib import Path

import zarr

from rigs.files import atomic_path
from tomo.export.export import Frames
from tomo.export.spectrum import check_even

VERSION = "0.5"

_LENGTHS = {
    "nm": "nanometer", "um": "micrometer", "µm": "micrometer", "mm": "millimeter",
    "cm": "centimeter", "m": "meter", "in": "inch", "ft": "foot",
}  # fmt: skip
"""The layout's names of units, by ours. An axis in another unit has none there."""


def write_ome_zarr(frames: Frames, target: Path) -> None:
    """Write the frames as an image ``(t, z, y, x)``, a chunk a frame."""
    if target.exists():
        raise FileExistsError(f"{target}: is there already, expected the name of a new store")
    store, grid = frames.store, frames.store.grid
    about, step = store.attributes, 1.0
    if len(frames) > 1:
        step = float(check_even(frames, "OME-Zarr").mean())
    length = _LENGTHS.get(about["length_unit"])
    time = {"unit": "second"} if about["time_unit"] == "s" else {}
    axes = [{"name": "t", "type": "time", **time}]
    axes += [
        {"name": name, "type": "space", **({"unit": length} if length else {})} for name in "zyx"
    ]
    place = [
        {"type": "scale", "scale": [step, *grid.spacing[::-1]]},
        {"type": "translation", "translation": [frames.times[0], *grid.origin[::-1]]},
    ]
    place = [{k: v if k == "type" else [float(n) for n in v] for k, v in p.items()} for p in place]
    image = {
        "name": "emission",
        "axes": axes,
        "datasets": [{"path": "0", "coordinateTransformations": place}],
    }
    with atomic_path(target) as temporary:
        group = zarr.create_group(
            temporary,
            zarr_format=3,
            attributes={
                "ome": {"version": VERSION, "multiscales": [image]},
                **frames.about(),
                "length_unit": about["length_unit"],
                "value_unit": about["value_unit"],
                "frames": frames.numbers.tolist(),
            },
        )
        nx, ny, nz = grid.shape
        array = group.create_array(
            "0",
            shape=(len(frames), nz, ny, nx),
            chunks=(1, *frames.chunk()[::-1]),
            dtype="f4",
            dimension_names=("t", "z", "y", "x"),
            attributes={"units": about["value_unit"]},
        )
        for number, volume in enumerate(frames.volumes()):
            array[number] = volume.T
