"""Two volumes beside each other: figures, slices, their difference, and a page of all."""

from __future__ import annotations

import os
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

from rigs.files.text import write_text
from rigs.notebook import times
from tomo import metrics
from tomo.draw.emission import COLOURS
from tomo.draw.figures import png_bytes, with_unit
from tomo.draw.page import embedded, render
from tomo.draw.scene import ColourScale
from tomo.draw.volume.planes import Slices, draw_slices
from tomo.grid import Volume
from tomo.radiometry import unit_of_total

if TYPE_CHECKING:
    from matplotlib.figure import Figure


@dataclass(frozen=True, eq=False)
class VolumeComparison:
    """Two volumes on the grid of the first, zero where one of them is NaN.

    ``notes`` are what was done to make them comparable, and what is not comparable.
    """

    first: Volume
    second: Volume
    names: tuple[str, str]
    notes: tuple[str, ...]

    def __repr__(self) -> str:
        """Name both and the difference."""
        first, second = self.names
        return f"<VolumeComparison: {second} with {first}, NRMSE {self.figures['nrmse']}>"

    @classmethod
    def of(
        cls, first: Volume, second: Volume, names: tuple[str, str] = ("A", "B")
    ) -> VolumeComparison:
        """Return the comparison; a second volume on another grid is resampled onto the first's.

        Raises
        ------
        ValueError
            If the units of length differ, or the grids have no place in common.
        """
        if first.length_unit != second.length_unit:
            raise ValueError(
                f"{names[1]}: length_unit: found {second.length_unit!r}, expected "
                f"{first.length_unit!r}, that of {names[0]}"
            )
        notes, grid, other = [], first.grid, second.grid
        if first.value_unit != second.value_unit:
            units = [one.value_unit or "no unit" for one in (first, second)]
            notes.append(f"units differ: {units[0]} and {units[1]}; numbers are as they are")
        if grid.coincides(other):
            second = first.like(second, second.value_unit)
        else:
            lower = np.maximum(grid.lower, other.lower)
            upper = np.minimum(grid.upper, other.upper)
            if not (upper > lower).all():
                raise ValueError(
                    f"{names[1]}: found {other!r}, expected a part of the box of {names[0]}, "
                    f"{grid!r}"
                )
            notes.append(
                f"{names[1]}, {_words(second)}, was resampled onto the grid of {names[0]}, "
                f"{_words(first)}"
            )
            second = second.resample(grid)
            outside = f"{1 - np.prod(upper - lower) / np.prod(grid.extent):.1%}"
            if outside != "0.0%":
                notes.append(
                    f"{outside} of the box of {names[0]} is outside that of {names[1]}, which "
                    "counts as 0 there"
                )
        unknown = np.isnan(first) | np.isnan(second)
        if unknown.any():
            first, second = (one.like(np.where(unknown, 0, one)) for one in (first, second))
            notes.append(f"{unknown.sum()} voxels are NaN in one of them, and left out")
        return cls(first, second, names, tuple(notes))

    @cached_property
    def figures(self) -> dict[str, Any]:
        """Plain numbers, as ``--json`` prints them; None where a figure has no value."""
        first, second = self.first, self.second
        pair = np.asarray(second), np.asarray(first)
        unit, factor = unit_of_total(first.value_unit, first.length_unit)
        each = {
            letter: {"name": name, "total": factor * one.total(), "peak": float(one.max())}
            for letter, name, one in zip("ab", self.names, (first, second), strict=True)
        }
        return {
            **each,
            "nrmse": _figure(metrics.nrmse, *pair),
            "cosine_distance": _figure(metrics.cosine_distance, *pair),
            "psnr": _figure(metrics.psnr, *pair),
            "ssim": _figure(metrics.ssim, *pair),
            "largest_difference": float(np.abs(pair[0] - pair[1]).max()),
            "total_ratio": _ratio(each["b"]["total"], each["a"]["total"]),
            "peak_ratio": _ratio(each["b"]["peak"], each["a"]["peak"]),
            "grid": first.grid.to_mapping(),
            "length_unit": first.length_unit,
            "value_unit": first.value_unit,
            "total_unit": unit,
            "notes": list(self.notes),
        }

    def draw(self) -> Figure:
        """Return the middle planes of both, on one scale, and those of second less first."""
        difference = self.second - self.first
        size = np.abs(np.asarray(difference))
        spread = float(np.quantile(size, 0.9995) or size.max()) or 1.0  # one voxel fades no other
        both = [float(one) for v in (self.first, self.second) for one in (v.min(), v.max())]
        low, high = min(0.0, *both), max(0.0, *both) or 1.0
        unit = self.first.value_unit
        scale = ColourScale(with_unit("emission", unit), low, high, COLOURS)
        less = ColourScale(with_unit("difference", unit), -spread, spread, "RdBu_r")
        first, second = (name if len(name) < 24 else f"…{name[-22:]}" for name in self.names)
        shown = (first, self.first, scale), (second, self.second, scale)
        return draw_slices([Slices(*one) for one in (*shown, ("difference", difference, less))])

    def write(self, path: str | os.PathLike) -> None:
        """Write a page that needs no other file and no network."""
        found, (first, second) = self.figures, self.names
        over = f"root mean square of the difference over that of {first}"
        headline = (
            ("nrmse", "{:.3g}", "NRMSE", over),
            ("cosine_distance", "{:.3g}", "Cosine distance", "0: equal up to a factor"),
            ("psnr", "{:.1f} dB", "PSNR", f"by the range of {first}"),
            ("ssim", "{:.3f}", "SSIM", "1: equal structure"),
            ("total_ratio", "{:.4f}", "Total", f"{second} over {first}"),
            ("peak_ratio", "{:.4f}", "Peak", f"{second} over {first}"),
        )
        page = render(
            "comparison.html",
            title=f"{second} beside {first}",
            about=_words(self.first),
            headline=[
                ("–" if found[key] is None else form.format(found[key]), name, words)
                for key, form, name, words in headline
            ],
            notes=self.notes,
            picture={
                "title": "Middle planes",
                "data": embedded(png_bytes(self.draw())),
                "alt": f"Three planes of {first}, of {second} and of their difference",
                "caption": f"Both on one scale; last {second} less {first}, red where more.",
            },
            titles=["Volume", with_unit("total", found["total_unit"]),
                    with_unit("peak", self.first.value_unit)],
            rows=[
                [found[key]["name"], f"{found[key]['total']:.6g}", f"{found[key]['peak']:.6g}"]
                for key in "ab"
            ],
        )  # fmt: skip
        write_text(path, page)


def _figure(metric: Callable, *pair: Any) -> float | None:
    """Return a figure; None where it has none, as for too few voxels, or is not finite."""
    try:
        found = metric(*pair)
    except ValueError:
        return None
    return found if np.isfinite(found) else None


def _words(volume: Volume) -> str:
    """Return a grid in words."""
    grid, unit = volume.grid, volume.length_unit
    middle = ", ".join(f"{value:.6g}" for value in grid.center)
    return f"{times(grid.shape)} voxels of {times(grid.spacing)} {unit} around ({middle})"


def _ratio(part: float, whole: float) -> float | None:
    return part / whole if whole else None
