"""Length units of rigs."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

from rigs.rig import Rig

#: Length units in metres.
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
UNKNOWN = "unit"  #: length unit of rigs from formats that name none
UNITS = (*_METRES, UNKNOWN)  #: all that are known
#: Figures of ``rig.calibration`` that are lengths, at any depth.
_LENGTHS = {
    "ray_miss",
    "ray_miss_predicted",
    "ray_miss_between_halves",
    "ray_miss_between_halves_expected",
    "pixel_footprint",
    "depth_range",
    "corners",  # of target poses
    "position_right_down_forward",  # of refined cameras
    "thickness",  # of adjusted windows, as those below
    "thickness_change",
    "thickness_error",
    "distance_change",
    "distance_error",
}


def in_unit(rig: Rig, unit: str) -> Rig:
    """Return ``rig`` with its lengths in ``unit``; lengths of unknown unit are taken as they are.

    The calibration's figures are converted too; its sentences keep the unit they were written in.
    """
    calibration = rig.calibration and _calibration_in(rig.calibration, rig.length_unit, unit)
    if rig.length_unit == UNKNOWN or rig.length_unit == unit:
        return replace(rig, length_unit=unit, calibration=calibration)
    scaled = rig.with_lengths_scaled(metres(rig.length_unit) / metres(unit))
    return replace(scaled, length_unit=unit, calibration=calibration)


def resized(rig: Rig, factor: float) -> Rig:
    """Return ``rig`` with all lengths ``factor`` times as large in its unit, figures included."""
    if factor == 1:
        return rig
    record, unit = rig.calibration, rig.length_unit
    if record and record.get("length_unit", unit) == unit:
        record = _lengths_scaled(record, factor)
    return replace(rig.with_lengths_scaled(factor), calibration=record)


def metres(unit: str) -> float:
    """Return the metres of a unit of length."""
    if unit not in _METRES:
        raise ValueError(f"length_unit: found {unit!r}, expected one of {', '.join(_METRES)}")
    return _METRES[unit]


def _calibration_in(summary: dict[str, Any], rig_unit: str, unit: str) -> dict[str, Any]:
    """Return a calibration's figures with its lengths in ``unit``."""
    own = summary.get("length_unit", rig_unit)
    if own == UNKNOWN:
        return summary | {"length_unit": unit}
    if own == unit or not {str(own), unit} <= _METRES.keys():
        return summary
    return _lengths_scaled(summary, _METRES[own] / _METRES[unit]) | {"length_unit": unit}


def _lengths_scaled(data: Any, factor: float, is_length: bool = False) -> Any:
    """Return plain data with all lengths in it ``factor`` times as large."""
    if isinstance(data, Mapping):
        return {
            key: _lengths_scaled(value, factor, key in _LENGTHS) for key, value in data.items()
        }
    if isinstance(data, list | tuple):
        return [_lengths_scaled(value, factor, is_length) for value in data]
    is_number = isinstance(data, int | float) and not isinstance(data, bool)
    return data * factor if is_length and is_number else data
