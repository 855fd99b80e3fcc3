"""From a scan to a volume: load, trace, solve, and evaluate the result."""

from __future__ import annotations

from tomo.grid import VoxelGrid
from tomo.operators.system import Progress
from tomo.pipeline.options import Options
from tomo.pipeline.reconstruction import Reconstruction
from tomo.pipeline.steps import reconstruct_as_asked
from tomo.scan import Scan


def reconstruct(
    scan: Scan,
    grid: VoxelGrid | None = None,
    options: Options = Options(),
    *,
    progress: Progress | None = None,
) -> Reconstruction:
    """Reconstruct the emission in every voxel from one frame of a scan.

    Parameters
    ----------
    scan : Scan
    grid : VoxelGrid, optional
        The scan's own when None.
    options : Options
    progress : callable, optional
        ``progress(done, total, where)``.

    Raises
    ------
    ValueError
        One line that names what is wrong with the input.
    """
    return reconstruct_as_asked(scan, scan.grid if grid is None else grid, options, progress)
