"""A rig's picture for print: the whole rig, and a close-up of the volume."""

from __future__ import annotations

import os
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from rigs import Rig
from tomo.draw import frame
from tomo.draw.emission import LIGHT, Looks
from tomo.draw.figures import INK, MUTED, new_figure, plain, save_figure
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
from tomo.draw.scene import Colour, Scene
from tomo.draw.shapes import box_corners
from tomo.draw.still import panel, show_light, show_scene, write_names
from tomo.draw.viewpoint import Viewpoint
from tomo.grid import VoxelGrid

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_DPI = 200
_NAMES_CLOSE_UP = 12  # more would hide the volume; colours tell them apart
_NEAR = ("arrows", "arrow names", "box", "field of view")


def draw_rig(
    rig: Rig,
    grid: VoxelGrid | None = None,
    volume: NDArray | None = None,
    title: str = "",
    supersample: int = 3,
    extra: Scene | None = None,
    value_unit: str = "",
    looks: Looks = LIGHT,
) -> Figure:
    """Return the figure: the rig at true scale on the left, the volume close up on the right.

    Parameters
    ----------
    rig : Rig
    grid : VoxelGrid, optional
        The box to draw; the rig's own when None. Without any the right half is left out.
    volume : (nx, ny, nz), optional
        Its light is drawn in the close-up.
    title : str
        Stands above the picture.
    supersample : int
        Rays along each side of a pixel.
    extra : Scene, optional
        What else to draw into the whole rig: another one, targets.
    value_unit : str
        Of the volume's values; empty if unknown.
    looks : Looks
        Of the volume.

    Raises
    ------
    ValueError
        As `rig_scene` does.
    """
    up = up_of(rig) if len(rig) else frame.Up()
    scene = rig_scene(rig, grid, None, up)
    scene = scene if extra is None else scene + extra
    grid = grid_of(rig, grid)
    width, height = (11.0, 6.0) if grid is not None else (7.5, 5.6)
    figure = new_figure(width, height, dpi=_DPI)
    left = (0.0, 0.07, 0.62 if grid is not None else 1.0, 0.87)
    overview, viewpoint = _overview(figure, left, rig, grid, scene, up, supersample)
    if grid is not None:
        right = (0.64, 0.075, 0.352, 0.835)
        closeup = _closeup(
            figure, right, rig, scene, up, supersample, grid, volume, value_unit, looks
        )
        _magnifier(
            figure, overview, closeup, viewpoint.project(box_corners(grid.lower, grid.upper))
        )
    shows_field = grid is not None and _field_fits(scene)
    x = _captions(figure, rig, grid, up, title, width, shows_field)
    for mesh in {mesh.group: mesh for mesh in (extra.meshes if extra else ())}.values():
        _entry(figure, x, mesh.colour, mesh.group)
        x += _entry_width(mesh.group, width)
    return figure


def write_rig(
    path: str | os.PathLike,
    rig: Rig,
    grid: VoxelGrid | None = None,
    volume: NDArray | None = None,
    title: str = "",
    supersample: int = 3,
    extra: Scene | None = None,
    value_unit: str = "",
    looks: Looks = LIGHT,
) -> None:
    """Write `draw_rig`'s figure as a PNG file."""
    save_figure(draw_rig(rig, grid, volume, title, supersample, extra, value_unit, looks), path)


def _overview(
    figure: Figure,
    rect: tuple,
    rig: Rig,
    grid: VoxelGrid | None,
    scene: Scene,
    up: frame.Up,
    supersample: int,
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
    viewpoint = Viewpoint.framing(
        np.vstack([box_corners(*bounds)]),
        up.eye_direction(frame.EYE[0], frame.EYE[1] + 5),
        up.vector,
        size,
        margins=(0.11, 0.06, 0.04, 0.13),
    )
    placer = show_scene(axes, whole, viewpoint, bounds, up, supersample)
    write_names(placer, whole, viewpoint, 7.5 if len(rig) <= 40 else 5.5)
    return axes, viewpoint


def _closeup(
    figure: Figure,
    rect: tuple,
    rig: Rig,
    scene: Scene,
    up: frame.Up,
    supersample: int,
    grid: VoxelGrid,
    volume: NDArray | None,
    value_unit: str,
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
        placer = show_scene(axes, near, viewpoint, bounds, up, supersample)
    else:
        placer = show_light(
            axes, volume, grid, near, viewpoint, bounds, up=up, supersample=supersample,
            value_unit=value_unit, looks=looks,
        )  # fmt: skip
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
    (left, top), (width, height) = lower, upper - lower
    frame_line = Rectangle((left, top), width, height, fill=False, edgecolor=INK, linewidth=0.8)
    overview.add_patch(frame_line)
    closeup.set_axis_on()
    closeup.set_xticks([])
    closeup.set_yticks([])
    for spine in closeup.spines.values():
        spine.set(color="#9aa5b1", linewidth=0.8)
    for y_here, y_there in ((lower[1], 1.0), (upper[1], 0.0)):
        line = ConnectionPatch(
            (upper[0], y_here),
            (0.0, y_there),
            overview.transData,
            closeup.transAxes,
            color="#b4bdc6",
            linewidth=0.6,
            linestyle=(0, (5, 3)),
        )
        figure.add_artist(line)


def _captions(
    figure: Figure,
    rig: Rig,
    grid: VoxelGrid | None,
    up: frame.Up,
    title: str,
    width: float,
    shows_field: bool,
) -> float:
    """Write the title, what each half shows, and the meaning of colours; return where they end."""
    unit, target = rig.length_unit, Target.of(rig, grid)
    distances = [np.linalg.norm(camera.position - target.center) for camera in rig]
    heading = title or "Camera rig"
    figure.text(
        0.012,
        0.965,
        heading,
        fontsize=11,
        weight="bold",
        color=INK,
        va="center",
        parse_math=False,
    )
    nearest, farthest = min(distances), max(distances)
    apart = (
        f"{nearest:.5g}"
        if np.isclose(nearest, farthest, rtol=1e-3)
        else (f"{nearest:.5g} to {farthest:.5g}")
    )
    plural = "cameras" if len(rig) > 1 else "camera"
    words = f"{len(rig)} {plural}, {apart} {unit} from the centre"
    figure.text(0.012, 0.925, plain(words), fontsize=8.5, color=MUTED, va="center")
    if grid is not None:
        size = " × ".join(f"{length:.4g}" for length in grid.extent)
        counts = " × ".join(str(n) for n in grid.shape)
        figure.text(0.64, 0.965, "Close-up of the volume", fontsize=9.5, weight="bold", color=INK)
        figure.text(
            0.64,
            0.945,
            plain(f"{size} {unit}, {counts} voxels"),
            fontsize=8,
            color=MUTED,
            va="top",
        )
    entries: dict[str, tuple[Colour, list[float]]] = {}
    for camera in rig:
        word, colour = colour_of(camera, target, up)
        entries.setdefault(word, (colour, []))[1].append(elevation_of(camera, target, up))
    x = 0.012
    for word in ("above", "level", "below"):
        if word not in entries:
            continue
        colour, angles = entries[word]
        low, high = min(angles) + 0.0, max(angles) + 0.0
        span = f"{low:+.0f}°" if high - low < 1 else f"{low:+.0f}° to {high:+.0f}°"
        span = span.replace("-", "\N{MINUS SIGN}")
        text = f"level ({len(angles)})" if word == "level" else f"{word}, {span} ({len(angles)})"
        _entry(figure, x, colour, text)
        x += _entry_width(text, width)
    if shows_field:
        name = facing_camera(rig, up).name
        name = name if len(name) <= 14 else f"{name[:12]}…"
        _entry(figure, 0.64, "#7d5ba6", f"field of view of {name}")
    widening = max(symbol_widening(camera) for camera in rig)
    if widening > 1.05:
        note = f"camera symbols opened up to {widening:.3g} times"
        edge = 0.61 if grid is not None else 0.99
        figure.text(edge, 0.066, note, fontsize=7, color=MUTED, ha="right", va="center")
    return x


def _entry_width(text: str, width: float) -> float:
    """Return the fraction of a figure ``width`` inches wide that an entry takes."""
    return (0.42 + 0.068 * len(text)) / width


def _entry(figure: Figure, x: float, colour: object, text: str) -> None:
    """Write one entry of the legend below the picture."""
    from matplotlib.patches import Rectangle

    figure.add_artist(
        Rectangle((x, 0.024), 0.011, 0.016, color=colour, transform=figure.transFigure, lw=0)
    )
    figure.text(x + 0.016, 0.032, text, fontsize=7.5, color=INK, va="center", parse_math=False)
