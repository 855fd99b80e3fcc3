"""A rig's picture for print: the whole rig, and a close-up of the volume."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from rigs import Rig
from tomo.draw import frame
from tomo.draw.emission import LIGHT, Looks
from tomo.draw.figures import INK, MUTED, PRINT_DPI, new_figure, plain
from tomo.draw.frame import Viewpoint
from tomo.draw.rig.rig_scene import (
    Target,
    colour_of,
    elevation_of,
    facing_camera,
    floor_height,
    grid_of,
    rig_scene,
    symbol_widening,
    typical_distance,
    up_of,
)
from tomo.draw.scene import Colour, Scene, rgb
from tomo.draw.shapes import box_corners
from tomo.draw.still import panel, show_light, show_scene, write_names
from tomo.grid import Volume, VoxelGrid

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_NAMES_CLOSE_UP = 12  # more would hide the volume; colours tell them apart
_NEAR = ("arrows", "arrow names", "box", "field of view")


def draw_rig(
    rig: Rig,
    grid: VoxelGrid | None = None,
    volume: Volume | None = None,
    *,
    title: str = "",
    extra: Scene | None = None,
    looks: Looks = LIGHT,
) -> Figure:
    """Return the figure: the rig at true scale on the left, the volume close up on the right.

    The box is the volume's, ``grid`` or the rig's own; without any the right half is left out.
    ``extra`` is drawn into the whole rig too: another one, targets.
    """
    grid = volume.grid if volume is not None else grid_of(rig, grid)
    up = up_of(rig) if len(rig) else frame.UP
    scene, extra = rig_scene(rig, grid, up), extra or Scene()
    figure = new_figure(*((11.0, 6.0) if grid is not None else (7.5, 5.6)), dpi=PRINT_DPI)
    left = (0.0, 0.07, 0.62 if grid is not None else 1.0, 0.87)
    overview, viewpoint = _overview(figure, left, rig, grid, scene + extra, up)
    head = (
        f"{len(rig)} camera{'s' if len(rig) > 1 else ''}, {_distances(rig, grid)} from the centre"
    )
    _heading(figure, 0.012, title or "Camera rig", head, 11)
    entries = _elevations(rig, grid, up)
    entries |= {mesh.group: mesh.colour for mesh in extra.meshes}
    if grid is not None:
        closeup = _closeup(
            figure, (0.64, 0.075, 0.352, 0.825), rig, grid, scene, up, volume, looks
        )
        box = viewpoint.project(box_corners(grid.lower, grid.upper))
        _magnifier(figure, overview, closeup, box)
        sizes = " × ".join(f"{length:.4g}" for length in grid.extent)
        counts = " × ".join(str(n) for n in grid.shape)
        words = f"{sizes} {rig.length_unit}, {counts} voxels"
        _heading(figure, 0.64, "Close-up of the volume", words, 9.5)
        if _field_fits(scene):
            name = facing_camera(rig, up).name
            name = name if len(name) <= 14 else f"{name[:12]}…"
            _legend(figure, 0.63, {f"field of view of {name}": rgb("#7d5ba6")})
    _legend(figure, 0.0, entries)
    widening = max(symbol_widening(camera) for camera in rig)
    if widening > 1.05:
        note = f"camera symbols opened up to {widening:.3g} times"
        edge = 0.61 if grid is not None else 0.99
        figure.text(edge, 0.066, note, fontsize=7, color=MUTED, ha="right", va="center")
    return figure


def _overview(
    figure: Figure, rect: tuple, rig: Rig, grid: VoxelGrid | None, scene: Scene, up: frame.Up
) -> tuple[Axes, Viewpoint]:
    """Draw the whole rig and return the viewpoint."""
    axes, size = panel(figure, rect)
    whole = scene.without("arrows", "arrow names", "field of view")
    target = Target.of(rig, grid)
    typical = typical_distance(rig, target)
    bounds = whole.bounds
    bounds[0 if up.sign > 0 else 1, up.axis] = floor_height(rig, target, typical, up)
    grow = 0.03 * typical * (np.arange(3) != up.axis)
    bounds += np.stack([-grow, grow])
    toward = up.eye_direction(frame.EYE[0], frame.EYE[1] + 5)
    margins = (0.11, 0.06, 0.04, 0.13)
    viewpoint = Viewpoint.framing(box_corners(*bounds), toward, up.vector, size, margins)
    placer = show_scene(axes, whole, viewpoint, bounds, up)
    write_names(placer, whole, viewpoint, 7.5 if len(rig) <= 40 else 5.5)
    return axes, viewpoint


def _closeup(
    figure: Figure,
    rect: tuple,
    rig: Rig,
    grid: VoxelGrid,
    scene: Scene,
    up: frame.Up,
    volume: Volume | None,
    looks: Looks,
) -> Axes:
    """Draw the box of voxels, what is in it, and from where it is seen."""
    axes, size = panel(figure, rect)
    near = scene.only(_NEAR)
    bounds = near.without("field of view").bounds
    if not _field_fits(near):
        near = near.without("field of view")
    viewpoint = Viewpoint.framing(
        np.vstack([box_corners(*bounds), *(mesh.vertices for mesh in near.meshes)]),
        up.eye_direction(*frame.EYE),
        up.vector,
        size,
        margins=(0.13 if volume is None else 0.21, 0.09, 0.03, 0.09),
        distance=5,
    )
    if volume is None:
        placer = show_scene(axes, near, viewpoint, bounds, up)
    else:
        placer = show_light(axes, volume, near, viewpoint, bounds, up=up, looks=looks)
    if len(rig) <= _NAMES_CLOSE_UP:
        write_names(placer, near, viewpoint, 6.5)
    return axes


def _field_fits(scene: Scene) -> bool:
    """Return whether the field of view is small enough to be drawn with the volume."""
    field = scene.only(["field of view"])
    if not field.meshes:
        return False
    rest = scene.without("field of view", *(g for g in scene.groups if g not in _NEAR)).bounds
    return bool(
        np.linalg.norm(np.ptp(field.bounds, axis=0)) < 3 * np.linalg.norm(np.ptp(rest, axis=0))
    )


def _magnifier(figure: Figure, overview: Axes, closeup: Axes, box: NDArray) -> None:
    """Mark the box of voxels in the overview and lead from it to the close-up."""
    from matplotlib.patches import ConnectionPatch, Rectangle

    lower, upper = np.nanmin(box, axis=0), np.nanmax(box, axis=0)
    grow = np.maximum(18 - (upper - lower), 8) / 2
    lower, upper = lower - grow, upper + grow
    overview.add_patch(Rectangle(lower, *(upper - lower), fill=False, edgecolor=INK, lw=0.8))
    closeup.set_axis_on()
    closeup.set_xticks([])
    closeup.set_yticks([])
    for spine in closeup.spines.values():
        spine.set(color="#9aa5b1", linewidth=0.8)
    for here, there in (((upper[0], lower[1]), (0, 1)), (upper, (0, 0))):
        coordinates = overview.transData, closeup.transAxes
        line = ConnectionPatch(
            here, there, *coordinates, color="#b4bdc6", linewidth=0.6, linestyle=(0, (5, 3))
        )
        figure.add_artist(line)


def _heading(figure: Figure, x: float, title: str, words: str, size: float) -> None:
    """Write a title, and words below it."""
    look: dict[str, Any] = {"va": "center", "parse_math": False}
    figure.text(x, 0.965, title, fontsize=size, weight="bold", color=INK, **look)
    figure.text(x, 0.925, words, fontsize=8.5, color=MUTED, **look)


def _distances(rig: Rig, grid: VoxelGrid | None) -> str:
    """Return how far the cameras are from the target, in words."""
    center = Target.of(rig, grid).center
    distances = [float(np.linalg.norm(camera.position - center)) for camera in rig]
    nearest, farthest = min(distances), max(distances)
    if np.isclose(nearest, farthest, rtol=1e-3):
        return f"{nearest:.5g} {rig.length_unit}"
    return f"{nearest:.5g} to {farthest:.5g} {rig.length_unit}"


def _elevations(rig: Rig, grid: VoxelGrid | None, up: frame.Up) -> dict[str, Colour]:
    """Return what the cameras' colours mean, with the number of cameras of each."""
    target = Target.of(rig, grid)
    entries: dict[str, Colour] = {}
    for wanted in ("above", "level", "below"):
        alike = [camera for camera in rig if colour_of(camera, target, up)[0] == wanted]
        if not alike:
            continue
        angles = [elevation_of(camera, target, up) + 0.0 for camera in alike]
        low, high = min(angles), max(angles)
        span = f"{low:+.0f}°" if high - low < 1 else f"{low:+.0f}° to {high:+.0f}°"
        span = "" if wanted == "level" else f", {span}".replace("-", "\N{MINUS SIGN}")
        entries[f"{wanted}{span} ({len(alike)})"] = colour_of(alike[0], target, up)[1]
    return entries


def _legend(figure: Figure, x: float, entries: dict[str, Colour]) -> None:
    """Write the meaning of colours below the picture."""
    from matplotlib.patches import Patch

    figure.legend(
        handles=[Patch(color=colour, label=plain(words)) for words, colour in entries.items()],
        loc="center left",
        bbox_to_anchor=(x, 0.032),
        ncols=len(entries),
        fontsize=7.5,
        labelcolor=INK,
        frameon=False,
        handlelength=1.3,
        handleheight=0.9,
        columnspacing=1.6,
    )
