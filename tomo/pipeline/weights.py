"""What the pixels of a reconstruction are worth to the default, and to what starts from it."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rigs import Rig
from tomo.grid import VoxelGrid
from tomo.measurement import NoiseModel, PixelWeights, weigh_pixels
from tomo.operators import LinearSystem
from tomo.operators.view_gains import Gains
from tomo.pipeline.check_options import methods_of
from tomo.pipeline.methods import AUTO
from tomo.pipeline.options import Options
from tomo.pipeline.screen import ScreenedScan
from tomo.scan.scan import Images, Masks


def weights_of(
    system: LinearSystem, screened: ScreenedScan, gains: Gains | None, options: Options
) -> tuple[NDArray[np.float32] | None, dict[str, Any]]:
    """Return the weights of the pixels that take part, ``(pixels,)``, and what a report says.

    None where all count alike.

    Parameters
    ----------
    system : LinearSystem
    screened : ScreenedScan
    gains : Gains, optional
        By which the pixels were corrected.
    options : Options
    """
    if not options.pixel_weights:
        return None, {"used": False, "reason": "not asked for"}
    if not any(one.name == AUTO or one.starts_from_default for one in methods_of(options)):
        return None, {"used": False, "reason": "for the default method, and what starts from it"}
    rig, grid = screened.training.rig, system.projector.grid
    found = weigh_images(rig, grid, screened.images, screened.masks, screened.noise)
    if found.images is None:
        return None, found.report()
    weights = system.flatten(found.images)
    if gains:
        weights = gains.correct_weights(system.projector, weights)
    return weights, found.report()


def weigh_images(
    rig: Rig, grid: VoxelGrid, images: Images, masks: Masks, noise: Sequence[NoiseModel]
) -> PixelWeights:
    """Weigh the pixels of a rig's images, of so much noise, that voxels are to explain.

    See `tomo.measurement.weigh_pixels`; a voxel is as many pixels across as in the grid's middle.
    """
    return weigh_pixels(images, masks, noise, max(grid.spacing) / rig.footprint(grid.center))
