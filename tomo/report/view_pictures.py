"""Measured, re-projected and difference image of each view, small enough for a page."""

from __future__ import annotations

import json
import math
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tomo.draw.emission import COLOURS
from tomo.draw.page import embedded, indexed_png, script_safe
from tomo.draw.rig.thumbnails import shrunk
from tomo.draw.scene import ColourScale
from tomo.pipeline.answer import worst_view
from tomo.pipeline.view import View

_SIDES = (256, 192, 128)  # pixels of the longer side, the first that fits
_LIMIT = 900_000  # bytes of all pictures: a third of a page that still loads at once
_GREY = "#b9c0c7"  # of pixels that were not used


def view_pictures(views: Sequence[View]) -> dict[str, Any] | None:
    """Return what the template of the comparison needs; None without views.

    The least explained view comes first in sight. Where the pictures of all views would take more
    than a page carries, they are those that took no part, the least explained one, and others
    evenly spread.
    """
    if not views:
        return None
    scaled = {view.name: _in_percent(view) for view in views}
    spread = [np.abs(parts[2][np.isfinite(parts[2])]) for parts in scaled.values()]
    limit = max((float(np.quantile(one, 0.995)) for one in spread if one.size), default=0.0) or 1.0
    scales = [ColourScale("", *ends) for ends in
              ((0, 100, COLOURS), (0, 100, COLOURS), (-limit, limit, "RdBu_r"))]  # fmt: skip
    for side in _SIDES:
        pictures = {
            name: [_png(shrunk(part, side), scale) for part, scale in zip(parts, scales,
                                                                          strict=True)]
            for name, parts in scaled.items()
        }  # fmt: skip
        total = sum(len(png) for three in pictures.values() for png in three)
        if total <= _LIMIT:
            break
    shown = views_to_show(views, max(1, math.floor(len(views) * min(1.0, _LIMIT / total))))
    shown = [view for view in views if view in shown]  # in the rig's order
    worst = worst_view(shown)
    entries = [
        {
            "words": _words(view, len(views) > 1 and view is worst),
            "images": [embedded(png) for png in pictures[view.name]],
        }
        for view in shown
    ]
    first = next((n for n, view in enumerate(shown) if view is worst), 0)
    return {
        "first": first,
        "last": len(shown) - 1,
        "shown": entries[first],
        "limit": f"{limit:.2g}",
        "left_out": len(views) - len(shown),
        "data": script_safe(json.dumps(entries)),
    }


def views_to_show(views: Sequence[View], most: int) -> list[View]:
    """Return views that took no part, the least explained one, then others evenly spread."""
    apart = [view for view in views if not view.takes_part]
    others = [view for view in views if view.takes_part]
    worst = worst_view(others)
    first = apart[: most - 1] + ([] if worst is None else [worst])
    others = [view for view in others if view is not worst]
    free = min(most - len(first), len(others))
    spread = np.round(np.arange(free) * len(others) / max(free, 1)).astype(int)
    return first + [others[i] for i in spread]


def _words(view: View, is_worst: bool) -> str:
    role = ", held out" if view.held_out else ", excluded" if view.excluded else ""
    role += ", explained least" if is_worst else ""
    if not math.isfinite(view.relative_residual):
        return f"{view.name}{role}: dark"
    figures = f"residual {view.relative_residual:.1%}, noise {view.relative_noise:.1%}"
    return f"{view.name}{role}: {figures}"


def _in_percent(view: View) -> tuple[NDArray, NDArray, NDArray]:
    """Return measured, re-projected and residual images; unusable pixels are NaN."""
    usable = view.usable
    measured = np.where(usable, view.measured, np.nan).astype(np.float32)
    reprojected = np.where(usable, view.reprojected, np.nan).astype(np.float32)
    highest = float(np.quantile(measured[usable], 0.9995)) if usable.any() else 0.0
    scale = 100 / (highest if highest > 0 else 1.0)
    return measured * scale, reprojected * scale, (reprojected - measured) * scale


def _png(values: NDArray, scale: ColourScale) -> bytes:
    """Return an image in 63 colours and grey: noise in more of them takes twice the bytes."""
    ratio = (values - scale.lower) / (scale.upper - scale.lower)
    steps = np.where(np.isfinite(ratio), np.round(62 * np.clip(np.nan_to_num(ratio), 0, 1)), 63)
    colours = scale(np.linspace(scale.lower, scale.upper, 63))
    grey = [int(_GREY[k : k + 2], 16) / 255 for k in (1, 3, 5)]
    return indexed_png(steps.astype(np.uint8), np.vstack([colours, grey]))
