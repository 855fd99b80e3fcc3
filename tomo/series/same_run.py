"""Whether a run may go on with a store: what it was made from and with, compared."""

from __future__ import annotations

import zlib
from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np
import yaml

from rigs.files.rig_yaml import rig_to_yaml
from tomo.pipeline.load import load
from tomo.pipeline.report_json import plain, versions
from tomo.series.frames import BLOCK
from tomo.series.plan import Plan
from tomo.series.store import SeriesStore

COMPARED = ("options", "scan", "rig", "grid", "block", "plan")
"""Attributes that decide the bits of a volume."""

COMPARED_VERSIONS = ("flametomo", "numpy", "numba", "scipy")
"""Packages whose other versions may round otherwise."""


def attributes_of(plan: Plan) -> dict[str, Any]:
    """Return the attributes of a plan's store: options, scan, rig, plan, versions and units."""
    scan, rate = plan.scan, plan.scan.frame_rate
    first = scan.frames[plan.places[0]].name
    return plain(
        {
            "options": plan.options.to_mapping(),
            "scan": {
                "frames": _names(plan),
                "scale": scan.shrink,
                "frame_rate": rate,
                "corrections": _corrections(plan),
                "key_images": _checksum(plan),
            },
            "rig": yaml.safe_load(rig_to_yaml(scan.rig)),
            "block": BLOCK,
            "plan": plan.report(),
            "cameras": list(scan.rig.names),
            "length_unit": scan.rig.length_unit,
            "value_unit": scan.value_unit(first),
            "time_unit": "1" if rate is None else "s",
            "versions": versions(),
            "plan_warnings": list(plan.warnings),
        }
    )


def check_same_run(store: SeriesStore, attributes: Mapping[str, Any]) -> None:
    """Refuse a store that another scan, rig, version or other options made.

    Raises
    ------
    ValueError
        One line with what differs.
    """
    pairs = [(name, store.attributes.get(name), attributes.get(name)) for name in COMPARED]
    known, ours = (one.get("versions") or {} for one in (store.attributes, attributes))
    pairs += [(f"versions.{n}", known.get(n), ours.get(n)) for n in COMPARED_VERSIONS]
    for name, found, wanted in pairs:
        for where, one, other in _differences(name, found, wanted):
            raise ValueError(
                f"{store.path}: {where}: found {_short(one)} in the store, and now "
                f"{_short(other)}: it was made by another run. Go on as it was begun, or write "
                "another store"
            )


def _differences(where: str, one: Any, other: Any) -> Iterator[tuple[str, Any, Any]]:
    """Yield the place and both values of what differs, the innermost first."""
    if isinstance(one, dict) and isinstance(other, dict):
        for key in [*one, *(key for key in other if key not in one)]:
            yield from _differences(f"{where}.{key}", one.get(key), other.get(key))
    elif isinstance(one, list) and isinstance(other, list) and len(one) == len(other):
        for place, (a, b) in enumerate(zip(one, other, strict=True)):
            yield from _differences(f"{where}[{place}]", a, b)
    elif one != other:
        yield where, one, other


def _short(value: Any) -> str:
    text = repr(value)
    return text if len(text) <= 80 else f"{text[:60]} ... ({len(text)} characters)"


def _names(plan: Plan) -> list[str]:
    return [plan.scan.frames[place].name for place in plan.places]


def _corrections(plan: Plan) -> dict[str, Any]:
    """Return the corrections, images of them by their check sums."""

    def each(value: Any) -> Any:
        if isinstance(value, Mapping):
            return {name: each(one) for name, one in value.items()}
        if isinstance(value, np.ndarray):
            return zlib.crc32(np.ascontiguousarray(value).tobytes())
        return str(value.name) if hasattr(value, "name") else value

    return {name: each(value) for name, value in vars(plan.scan.corrections).items()}


def _checksum(plan: Plan) -> int:
    """Return a check sum of the key frames' images, corrected."""
    found = 0
    for place in plan.keys:
        loaded = load(plan.scan, plan.scan.frames[place].name)
        held = plan.options.hold_out
        for name, image in zip(plan.scan.rig.names, loaded.images, strict=True):
            if name not in held:
                found = zlib.crc32(np.ascontiguousarray(image).tobytes(), found)
    return found
