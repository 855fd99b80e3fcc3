"""The pictures of a reconstruction, drawn once; and the images of each view, small for a page."""

from __future__ import annotations

import json
import math
import os
from collections.abc import Callable, Collection, Sequence
from contextlib import nullcontext
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, cast

import numpy as np
from numpy.typing import NDArray

from rigs.files.text import write_bytes
from tomo.draw.emission import COLOURS
from tomo.draw.figures import png_bytes, raised
from tomo.draw.page import embedded, indexed_png, script_safe
from tomo.draw.rig.thumbnails import shrunk
from tomo.draw.scene import ColourScale, rgb
from tomo.pipeline import Reconstruction
from tomo.pipeline.answer import worst_view
from tomo.pipeline.stage import as_warning
from tomo.pipeline.view import View

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from tomo.pipeline.learned_weights import LearnedWeights

SHOWN = 0.57
"""Width of a picture on a page over its own pixels: the widest then fill a page on a large screen,
and texts have one size in all."""

_SIDES = (256, 192, 128)  # pixels of the longer side, the first that fits
_LIMIT = 900_000  # bytes of all pictures: a third of a page that still loads at once
_GREY = rgb("#b9c0c7")  # of pixels that were not used


@dataclass(frozen=True, eq=False)
class Picture:
    """A figure as PNG, with the words that go with it."""

    name: str
    png: bytes
    caption: str
    alt: str

    @property
    def width(self) -> int:
        """The width in a page's pixels, from the PNG's header."""
        return round(SHOWN * int.from_bytes(self.png[16:20], "big"))

    def __repr__(self) -> str:
        """Name the size: the bytes themselves are too long to print."""
        return f"<Picture {self.name!r}: {len(self.png)} bytes>"


def draw(
    outcome: Reconstruction, warnings: list[str] | None = None, known: Collection[str] = ()
) -> tuple[Picture, ...]:
    """Return the figures but for those ``known``; those that there is nothing for are left out.

    Rig, volume, convergence, difference, learned weights, intervals and deviations. Of one
    that cannot be drawn, as where a library of the system is missing, a line joins ``warnings``;
    it raises where these are None.
    """
    pictures = []
    for wanted, name, make, caption, alt in _recipes(outcome):
        if wanted and name not in known:
            step = f"picture {name}: not drawn"
            with nullcontext() if warnings is None else as_warning(step, warnings):
                pictures.append(Picture(name, png_bytes(make()), caption, alt))
    return tuple(pictures)


def write_pictures(folder: str | os.PathLike, pictures: Sequence[Picture]) -> list[Path]:
    """Write each picture as ``NAME.png`` into ``folder``; return the paths."""
    paths = [Path(folder) / f"{picture.name}.png" for picture in pictures]
    for path, picture in zip(paths, pictures, strict=True):
        write_bytes(path, picture.png)
    return paths


def _recipes(outcome: Reconstruction) -> list[tuple[bool, str, Callable[[], Figure], str, str]]:
    """Return for each picture if it is wanted, its name, what draws it, and its words."""
    from tomo.draw.rig.rig_picture import draw_rig
    from tomo.draw.volume.visualize import draw_volume
    from tomo.report import result_figures as figures

    volume, rig, truth = figures.seen_volume(outcome), outcome.rig, outcome.truth
    history = (outcome.solution, *outcome.comparisons)
    has_distance = any(one.distance is not None for course in history for one in course.history)
    in_units = f" in {raised(outcome.value_unit)}" if outcome.value_unit else ""
    learned = cast("LearnedWeights", outcome.learned)
    intervals = "Half-width of the 90 % interval"
    return [
        (
            len(rig) > 0,
            "rig",
            lambda: draw_rig(rig, volume=volume, title="Cameras and volume"),
            "The cameras at true scale, and the volume close up. Colours tell whether a camera "
            "stands above, level with or below the volume; the arrows show where each looks.",
            f"Perspective drawing of {len(rig)} cameras around the reconstructed volume.",
        ),
        (
            True,
            "flame",
            lambda: draw_volume(volume, title="Reconstruction"),
            f"The reconstructed emission{in_units}: its light as a camera sees it, and "
            "planes through the middle of the volume.",
            "The light of the reconstructed volume, and three slices.",
        ),
        (
            any(course.history for course in history),
            "convergence",
            lambda: figures.draw_convergence(history),
            "How far the re-projected images are from the measured ones after each iteration"
            + (", and how far the volume is from the truth." if has_distance else "."),
            "Line plots of relative residual against iteration and against time.",
        ),
        (
            truth is not None or bool(outcome.comparisons),
            "difference",
            lambda: figures.draw_difference(outcome),
            "Every volume on one colour scale"
            + ("." if truth is None else ", and beside it its difference from the truth."),
            "Middle planes of every volume, on one colour scale.",
        ),
        (
            learned is not None,
            "learned",
            lambda: figures.draw_learned(learned, rig.length_unit),
            "Learned weights over segment lengths: means over the emission (grey: where it is) by "
            "depth in the grid as seen from the camera, upstream emission, and angle off the "
            "image's middle; and the relative residual of pixels left out, by segment lengths "
            "and by learned weights. A common factor has no meaning.",
            "Line plots of the learned weight over the segment length against three quantities; "
            "bars of left-out pixels' residuals.",
        ),
        (
            outcome.half_width is not None,
            "intervals",
            lambda: figures.draw_deviations(volume, outcome.half_width, intervals),
            "Planes through the middle of the volume, and of the half-width of each voxel's 90 % "
            "interval, noise and structure together. Each has its own scale: where the number on "
            "the right comes near that on the left, the value is a guess.",
            "Middle planes of the emission and of the half-width of its 90 % intervals.",
        ),
        (
            outcome.standard_deviation is not None,
            "condition",
            lambda: figures.draw_deviations(volume, outcome.standard_deviation),
            "Planes through the middle of the volume, and of the standard deviation that noise "
            "leaves in each voxel, each on its own scale.",
            "Middle planes of the emission and of its standard deviation side by side.",
        ),
    ]


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
            name: [_png(shrunk(parts[k], side), scale) for k, scale in enumerate(scales)]
            for name, parts in scaled.items()
        }
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
    return indexed_png(steps.astype(np.uint8), np.vstack([colours, _GREY]))
