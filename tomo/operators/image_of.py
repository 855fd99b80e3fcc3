"""The image of a volume in one camera."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from rigs import CameraLike, Rig
from tomo.grid import Volume
from tomo.operators.absorption import Absorption, extinction_of
from tomo.operators.memory import ON_THE_FLY
from tomo.operators.system import LinearSystem, VolumeNotSeenError


def image_of(volume: Volume, camera: CameraLike, supersample: int = 1) -> NDArray[np.float32]:
    """Return the image of a volume in a camera, ``(rows, columns)``: line integrals of voxels.

    In the volume's unit times its unit of length, which is the camera's; what that looks through,
    glass and gas, is followed. Zero where a pixel does not see the grid; NaN emits nothing. A
    pixel is the mean of ``supersample`` rays along each side.
    """
    rig = Rig((camera,))
    try:
        system = LinearSystem.from_rig(rig, volume.grid, supersample=supersample, form=ON_THE_FLY)
    except VolumeNotSeenError:
        width, height = camera.image_size
        return np.zeros((height, width), np.float32)
    extinction = extinction_of(rig)
    if extinction is not None:
        gas = Absorption(extinction=extinction)
        system = system.with_absorption(gas, supersample=supersample)
    values = np.nan_to_num(np.asarray(volume, np.float32), nan=0.0)
    return system.images(system.projector @ values.ravel())[0]
