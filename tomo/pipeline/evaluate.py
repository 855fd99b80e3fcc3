"""What a reconstruction is judged by: truth, cameras held out, images beside re-projections."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from rigs.recordings import is_integer_image
from tomo.grid import VoxelGrid
from tomo.io import read_volume
from tomo.operators import LinearSystem
from tomo.operators.system import VolumeNotSeenError
from tomo.pipeline.reconstruction import View
from tomo.scan import Scan
from tomo.scan.scan import Images, Masks
from tomo.selfcal.gains import Gains
from tomo.solvers import Solution

if TYPE_CHECKING:
    from tomo.wernet.default import LearnedWeights


def read_truth(scan: Scan, grid: VoxelGrid) -> tuple[NDArray[np.float32] | None, list[str]]:
    """Return the scan's truth if it lives on the grid, and a warning if it does not."""
    if scan.truth is None:
        return None, []
    data, truth_grid, _ = read_volume(scan.truth)
    apart = np.abs([truth_grid.lower - grid.lower, truth_grid.upper - grid.upper]).max()
    if truth_grid.shape == grid.shape and apart <= 1e-6 * min(grid.spacing):
        return data, []
    return None, [f"{scan.truth.name}: the truth is on another grid: no quality figures"]


def held_out_system(
    judged: Scan | None, grid: VoxelGrid, masks: Masks, how: dict[str, Any]
) -> LinearSystem | None:
    """Trace the cameras that are only judged, before anything is solved in vain."""
    if judged is None:
        return None
    try:
        return LinearSystem.from_rig(judged.rig, grid, masks=masks, **how)
    except VolumeNotSeenError as error:
        raise VolumeNotSeenError(
            f"{judged.source}: hold_out: nothing to judge by: {error}"
        ) from None


def as_learned(system: LinearSystem, found: Solution, same_views: bool) -> LinearSystem:
    """Return the system with the weights that were learnt, where there are any."""
    if found.weights is None:
        return system
    learned = found.weights.projector(system.projector, same_views=same_views)
    return replace(system, projector=learned)


def summed_up(
    system: LinearSystem,
    seeing: LinearSystem,
    found: Solution,
    ratios: NDArray[np.float64] | None,
) -> LearnedWeights:
    """Return what the weights of ``seeing`` are over the chords, beside the true ratios."""
    from tomo.wernet.default import LearnedWeights

    return LearnedWeights.of(
        found.weights,
        system.projector,
        seeing.projector,
        found.volume,
        system.rig.names,
        held_out_residual=found.settings.get("held_out_residual"),
        truth=ratios,
    )


def views_of(
    system: LinearSystem,
    volume: NDArray[np.float32],
    images: Images,
    masks: Masks,
    gains: Gains | None = None,
) -> list[View]:
    """Return each camera's image beside what the volume would have shown it."""
    projected = system.projector @ system.projector.active.compress(volume)
    reprojected = system.images(gains.apply(system.projector, projected) if gains else projected)
    return [
        View(camera.name, image, seen, mask)
        for camera, image, seen, mask in zip(system.rig, images, reprojected, masks, strict=True)
    ]


def data_range(scan: Scan, frame: str | None, images: Images) -> float:
    """Return 1 where integer images were scaled to 0..1, else the brightest pixel."""
    files = scan.frame(frame).images.values()
    if scan.corrections.gain is None and all(is_integer_image(path) for path in files):
        return 1.0
    return max(max(float(image.max()) for image in images), np.finfo(np.float32).tiny)
