"""What the pixels of a reconstruction are worth to the default, and to what starts from it."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from tomo._gains import Gains
from tomo._request import Request
from tomo._sieve import Sieved
from tomo.linear_system import LinearSystem
from tomo.methods import AUTO
from tomo.support import weigh_pixels


def weights_of(
    system: LinearSystem, sieved: Sieved, gains: Gains | None, request: Request
) -> tuple[NDArray[np.float32] | None, dict[str, Any]]:
    """Return the weights of the pixels that take part, ``(pixels,)``, and what a report says.

    None where all count alike.

    Parameters
    ----------
    system : LinearSystem
    sieved : Sieved
    gains : Gains, optional
        By which the pixels were corrected.
    request : Request
    """
    if not request.weigh:
        return None, {"used": False, "reason": "not asked for"}
    if not any(one.name == AUTO or one.starts_from_default for one in request.methods):
        return None, {"used": False, "reason": "for the default method, and what starts from it"}
    grid = system.projector.grid
    pixels_a_voxel = max(grid.spacing) / sieved.training.rig.footprint(grid.center)
    found = weigh_pixels(sieved.images, sieved.masks, sieved.noise, pixels_a_voxel)
    if found.images is None:
        return None, found.report()
    weights = system.flatten(found.images)
    if gains:
        weights = gains.correct_weights(system.projector, weights)
    return weights, found.report()
