"""Whether a scene fits its rig: units, windows in the volume, pixels that see hardware alone."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from rigs.scene.gas.gas import reaches_into
from rigs.scene.materials import Glass
from rigs.scene.scene import Scene

if TYPE_CHECKING:
    from rigs.rig import Rig

UNLIKELY = 300
"""Ratio of the cameras' distance to the largest solid, either way, that a wrong unit explains:
mm for m is 1000, and a nozzle at a twentieth of the distance is a right one."""


def check_scene(scene: Scene, rig: Rig) -> None:
    """Raise if a scene cannot stand in front of a rig's cameras.

    Raises
    ------
    ValueError
        If glass reaches into the volume, or the sizes differ as by a wrong unit. A camera in a
        solid is found by `rigs.scene.SceneCamera`.
    """
    if not scene.solids:
        return
    middle = np.zeros(3) if rig.volume is None else np.array(rig.volume.center)
    far = max(float(np.linalg.norm(camera.position - middle)) for camera in rig)
    size = max(
        (solid.diameter for solid in scene.solids if math.isfinite(solid.diameter)), default=far
    )
    if far > 0 and not far / UNLIKELY < size < far * UNLIKELY:
        raise ValueError(
            f"scene: found a largest solid of {size:.4g} {rig.length_unit} before cameras "
            f"{far:.4g} {rig.length_unit} away, expected like sizes: check the units of both "
            "(a mesh takes unit: m)"
        )
    if rig.volume is not None:
        _check_volume(scene, rig.volume.corners())


def _check_volume(scene: Scene, corners: NDArray[np.float64]) -> None:
    """Raise if glass reaches into the box of those corners."""
    low, high = corners.min(axis=0), corners.max(axis=0)
    for solid in scene.solids:
        # hardware may stand in the flame
        if isinstance(solid.material, Glass) and reaches_into(solid, low, high):
            raise ValueError(
                f"scene: solid {solid.name}: reaches into the volume from {_point(low)} to "
                f"{_point(high)}, expected glass outside: move it, or make the volume smaller"
            )


def _point(point: NDArray[np.float64]) -> str:
    return "(" + ", ".join(f"{x:.4g}" for x in point) + ")"
