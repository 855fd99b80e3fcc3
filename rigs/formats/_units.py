"""Length units of rigs."""

from __future__ import annotations

from dataclasses import fields, replace

from rigs.camera import Camera
from rigs.ray_table import RayTable
from rigs.rig import Rig, Volume

#: In metres.
_METRES = {
    "m": 1.0,
    "dm": 1e-1,
    "cm": 1e-2,
    "mm": 1e-3,
    "um": 1e-6,
    "µm": 1e-6,
    "in": 0.0254,
    "ft": 0.3048,
}
UNKNOWN = "unit"  #: of formats that do not say what their lengths are in


def in_unit(rig: Rig, unit: str) -> Rig:
    """Return ``rig`` with its lengths in ``unit``; lengths of unknown unit are taken to be."""
    if rig.length_unit == UNKNOWN or rig.length_unit == unit:
        return replace(rig, length_unit=unit)
    for name in (rig.length_unit, unit):
        if name not in _METRES:
            raise ValueError(f"length_unit: found {name!r}, expected one of {', '.join(_METRES)}")
    factor = _METRES[rig.length_unit] / _METRES[unit]
    return replace(
        rig,
        cameras=tuple(_scaled(camera, factor) for camera in rig),
        length_unit=unit,
        volume=rig.volume and _scaled_volume(rig.volume, factor),
    )


def _scaled(camera: Camera | RayTable, factor: float) -> Camera | RayTable:
    """Return the camera of a world whose lengths are ``factor`` times as large."""
    optics = camera.optics
    if optics is not None:
        lengths = {f.name: getattr(optics, f.name) for f in fields(optics) if f.name != "f_number"}
        optics = replace(optics, **{k: v and v * factor for k, v in lengths.items()})
    if isinstance(camera, RayTable):
        return replace(camera, origins=camera.own_origins * factor, optics=optics)
    return replace(camera, t=camera.t * factor, optics=optics)


def _scaled_volume(volume: Volume, factor: float) -> Volume:
    """Return the box of a world whose lengths are ``factor`` times as large."""
    return Volume(
        volume.shape,
        tuple(length * factor for length in volume.spacing),
        tuple(length * factor for length in volume.center),
    )
