"""Write texts into a picture so that none covers another."""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.text import Text

_TURNS = (0.0, 25.0, -25.0, 50.0, -50.0, 80.0, -80.0, 120.0, -120.0, 180.0)  # degrees
_REACHES = (1.0, 2.5, 4.5, 7.0, 10.0)  # in gaps


@dataclass
class LabelPlacer:
    """Places texts one by one on ``axes``, whose data coordinates are pixels, rows downward.

    Each text is placed as near to its anchor as the earlier texts allow. A text far from its
    anchor gets a thin line to it. A text without a free position is omitted. ``halo`` is the
    ground's colour.
    """

    axes: Axes
    size: tuple[int, int]
    halo: str = "white"
    taken: list[tuple[float, float, float, float]] = field(default_factory=list)

    def place(
        self,
        text: str,
        anchor: np.ndarray,
        outward: np.ndarray,
        *,
        gap: float,
        colour: tuple | str = "#1b2733",
        fontsize: float = 8.0,
        leader: bool = True,
        turns: tuple[float, ...] = _TURNS,
        reaches: tuple[float, ...] = _REACHES,
    ) -> bool:
        """Write ``text`` near pixel ``anchor``, moved ``outward``; return whether it fits."""
        from matplotlib.patheffects import withStroke

        norm = float(np.linalg.norm(outward))
        if not (np.isfinite(anchor).all() and math.isfinite(norm)):
            return False
        base = math.atan2(outward[1], outward[0]) if norm > 1e-9 else -math.pi / 2
        written = self.axes.text(
            0,
            0,
            text,
            fontsize=fontsize,
            color=colour,
            ha="center",
            va="center",
            zorder=6,
            parse_math=False,
        )
        width, height = self._measure(written)
        tries = sorted(
            itertools.product(reaches, turns), key=lambda t: t[0] / 2.5 + abs(t[1]) / 25
        )
        for reach, turn in tries:
            angle = base + math.radians(turn)
            way = np.array([math.cos(angle), math.sin(angle)])
            # the text's box touches the circle of radius reach * gap from outside
            centre = anchor + way * reach * gap + way * (np.abs(way) @ [width / 2, height / 2])
            box = (
                centre[0] - width / 2 - 4,
                centre[1] - height / 2 - 1,
                centre[0] + width / 2 + 4,
                centre[1] + height / 2 + 1,
            )
            if self._is_free(box):
                written.set_position(centre)
                written.set_path_effects([withStroke(linewidth=1.8, foreground=self.halo)])
                self.taken.append(box)
                if leader and reach * gap > 14:
                    near = anchor + way * (reach * gap - 1)
                    self.axes.plot(
                        [anchor[0], near[0]], [anchor[1], near[1]], color="#8a95a1", lw=0.5
                    )
                return True
        written.remove()
        return False

    def _measure(self, written: Text) -> tuple[float, float]:
        """Return width and height of a text in data coordinates."""
        extent = written.get_window_extent()
        corners = self.axes.transData.inverted().transform(extent.corners())
        width, height = np.ptp(corners, axis=0).tolist()
        return width, height

    def _is_free(self, box: tuple[float, float, float, float]) -> bool:
        """Return whether ``box`` is inside the picture and touches no text."""
        left, top, right, bottom = box
        if left < 0 or top < 0 or right > self.size[0] or bottom > self.size[1]:
            return False
        return all(
            right <= other[0] or left >= other[2] or bottom <= other[1] or top >= other[3]
            for other in self.taken
        )
