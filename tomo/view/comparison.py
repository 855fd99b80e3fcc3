"""One camera's measured image beside the image that the volume would have shown it."""

from __future__ import annotations

import numpy as np

from tomo.operators import LinearSystem
from tomo.operators.system import VolumeNotSeenError
from tomo.pipeline.evaluate import views_of
from tomo.pipeline.view import View
from tomo.view.content import Content


def compare(content: Content, camera: str, place: int) -> View:
    """Return a camera's image of a moment beside the line integrals of the volume.

    Parameters
    ----------
    content : Content
        With a scan. Its model holds the basis, gains and backgrounds of the volume; without a
        volume the re-projected image is dark.
    camera : str
    place : int
        The frame's.

    Notes
    -----
    One ray goes through each pixel's middle. Blur, absorption and learned weights of a
    reconstruction are not applied: see the residual on record.
    """
    assert content.scan is not None  # contents without one offer no camera to compare
    own = content.scan.only(camera)
    images, masks = own.read(content.moments[place])
    dark = View(camera, images[0], np.zeros_like(images[0]), masks[0])
    if content.frames is None:
        return dark
    try:
        system = LinearSystem.from_rig(own.rig, content.grid, masks=masks, form="on-the-fly")
    except VolumeNotSeenError:
        return dark
    if content.model.is_linear:
        system = system.with_linear_basis().on_voxel_means
    gains = content.model.gains_of(camera)
    return views_of(system, content.frames.volume(place), images, masks, gains)[0]
