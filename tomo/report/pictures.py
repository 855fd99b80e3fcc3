"""The pictures of a reconstruction: drawn once, written as PNG files and shown in the report."""

from __future__ import annotations

import os
from collections.abc import Callable, Collection, Sequence
from contextlib import nullcontext
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, cast

from rigs.files import atomic_path
from tomo.draw.figures import png_bytes, raised
from tomo.pipeline import Reconstruction
from tomo.pipeline.stage import as_warning

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from tomo.pipeline.learned_weights import LearnedWeights

SHOWN = 0.57
"""Width of a picture on a page over its own pixels: the widest then fill a page on a large screen,
and texts have one size in all."""


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
    paths = []
    for picture in pictures:
        path = Path(folder) / f"{picture.name}.png"
        with atomic_path(path) as temporary:
            temporary.write_bytes(picture.png)
        paths.append(path)
    return paths


def _recipes(outcome: Reconstruction) -> list[tuple[bool, str, Callable[[], Figure], str, str]]:
    """Return for each picture if it is wanted, its name, what draws it, and its words."""
    from tomo.draw.rig import draw_rig
    from tomo.draw.volume import draw_volume
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
