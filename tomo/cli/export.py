"""``flametomo export``: the frames of a store as files of other programs."""

from __future__ import annotations

from pathlib import Path

from tomo.cli.console import print_json, say
from tomo.cli.inputs import check_output_folder

EXAMPLES = """
flametomo export out.zarr --to pvd -o flame.pvd
flametomo export out.zarr --to ome-zarr -o flame.ome.zarr
flametomo export out.zarr --to mp4 -o flame.mp4
flametomo export out.zarr --to npz --frames 0:100:10 -o volumes
flametomo export out.zarr --to statistics -o statistics.zarr
"""


def export(store: Path, /, *, out: Path, to: str, frames: str = ":", json: bool = False) -> None:
    """Write the frames of a store for other programs, or their statistics.

    Parameters
    ----------
    store : STORE
        The store that reconstruct --frames wrote.
    out : OUT
        The file or folder to write.
    to : FORMAT
        pvd: a collection for ParaView beside a folder of .vti files. vtkhdf: one file for
        ParaView. ome-zarr: an image t, z, y, x for napari and Fiji. netcdf: one file with
        coordinates. npz: a folder of NumPy files. mp4: the light along lines of
        sight. statistics: mean and RMS fluctuation of every voxel. spectrum: its power spectral
        density over time.
    frames : A:B:C
        A slice of the store's frames, counted from 0.
    """
    from tomo.export import export_series
    from tomo.series.frames import slices_of
    from tomo.series.store import SeriesStore

    opened = SeriesStore(store)
    places = slices_of(frames, opened.n_frames)
    check_output_folder(out.parent)
    written = export_series(opened, out, to, places, progress=True)
    numbers, skipped = opened.values("frame"), opened.skipped
    left_out = [int(numbers[place]) for place in places if skipped[place]]
    count = len(places) - len(left_out)
    say(f"{written}: {count} frames of {store}")
    if left_out:
        say(
            f"warning: {len(left_out)} frames that could not be read are left out, the first is "
            f"{left_out[0]}",
            "yellow",
        )
    if json:
        result = {"store": str(store), "out": str(written), "to": to, "frames": count}
        print_json(result | {"left_out": left_out})
