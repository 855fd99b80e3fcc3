"""Write a scene as one interactive HTML page that works without a network (plotly inlined)."""

from __future__ import annotations

import html
import json
import os
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rigs.files import atomic_path
from tomo.draw.frame import EYE, Up
from tomo.draw.page import render, script_safe
from tomo.draw.rig.camera_view import CameraView
from tomo.draw.scene import Label, Mesh, Scene
from tomo.draw.traces import RAY_COLOUR, RAYS, css, group_traces, no_rays, steps
from tomo.draw.volume.maps import MAP, emission_map
from tomo.grid import VoxelGrid

_ORDER = (
    "cameras",
    "names",
    "images",
    "sight lines",
    "field of view",
    "arrows",
    "arrow names",
    "other cameras",
    "other names",
    "moved",
    "targets",
    "target names",
    RAYS,
    "box",
)
"""Layers that come first in the list; the others follow in the order of the scene."""

HIDDEN_AT_FIRST = ("arrow names", "other names", "field of view", "images")


@dataclass(frozen=True)
class Table:
    """A table of texts and numbers next to the scene.

    Attributes
    ----------
    title : str
    lines : tuple of (str, str)
        A kind (``fault``, ``warning``, ``note`` or ``""``) and a text each.
    head : tuple of str
        Headings of the columns; empty where there are no rows.
    rows : tuple of tuple of str
    """

    title: str
    lines: tuple[tuple[str, str], ...] = ()
    head: tuple[str, ...] = ()
    rows: tuple[tuple[str, ...], ...] = ()


def write_html(
    path: str | os.PathLike, scene: Scene, *, leave_out: tuple[str, ...] = ("stems",), **page: Any
) -> None:
    """Write the page: every group is a layer to switch on and off, hovering shows names.

    Parameters
    ----------
    path : path-like
    scene : Scene
    leave_out : tuple of str
        Groups not to show.
    page
        Further arguments of `html_page`.
    """
    text = html_page(scene.without(*leave_out), **page)
    with atomic_path(path) as temporary:
        temporary.write_text(text, encoding="utf-8")


def html_page(
    scene: Scene,
    *,
    title: str = "",
    up: Up | None = None,
    grid: VoxelGrid | None = None,
    volume: NDArray | None = None,
    value_unit: str = "",
    views: Sequence[CameraView] = (),
    tables: Sequence[Table] = (),
    shown: Sequence[str] = (),
    close_up: bool = False,
) -> str:
    """Return the page that `write_html` writes.

    Parameters
    ----------
    scene : Scene
    title : str
        Title of the page; plain text.
    up : Up, optional
        Which axis points upward.
    grid : VoxelGrid, optional
        Adds buttons that show the whole scene or the box alone.
    volume : (nx, ny, nz), optional
        Adds its three middle planes, switched off at first.
    value_unit : str
        Of its values; empty if unknown.
    views : sequence of CameraView
        Adds a panel of their pictures; a pixel clicked there shows its ray.
    tables : sequence of Table
        Tables below the layers.
    shown : sequence of str
        Groups to show at first that are hidden otherwise: maps, images, names of arrows.
    close_up : bool
        Whether to start with the box alone in view.
    """
    import plotly.graph_objects as go
    from plotly.offline import get_plotlyjs

    up = up or Up()
    if volume is not None and grid is not None:
        scene = scene + emission_map(volume, grid, scene.length_unit, value_unit)
    bounds = scene.bounds
    traces: list[go.Mesh3d | go.Scatter3d] = []
    layers = []
    for group in scene.groups:
        visible = group in shown or not (group in HIDDEN_AT_FIRST or group.startswith(MAP))
        made = group_traces(scene, group, visible)
        numbers = list(range(len(traces), len(traces) + len(made)))
        layers.append(_layer(scene, group, visible, numbers))
        traces += made
    if views:
        layers.append(
            {"name": RAYS, "traces": [len(traces)], "visible": True, "colours": [RAY_COLOUR]}
        )
        traces.append(no_rays())
    layers.sort(key=lambda layer: (*_ORDER, layer["name"]).index(layer["name"]))
    in_view = _around(grid) if close_up and grid is not None else bounds
    figure = go.Figure(traces, _layout(scene.length_unit, in_view, up))
    data = {
        "layers": layers,
        "labels": [
            {
                "text": label.text,
                "layer": label.group,
                "position": label.position.tolist(),
                "outward": label.outward.tolist(),
                "colour": css(label.colour),
            }
            for label in scene.labels
        ],
        "zooms": _zooms(bounds, grid) if grid is not None and "cameras" in scene.groups else [],
        "views": [view.data() for view in views],
        "box": None if grid is None else [grid.lower.tolist(), grid.upper.tolist()],
        "bounds": bounds.tolist(),
        "unit": scene.length_unit,
    }
    return render(
        "scene.html",
        title=title or "Scene",
        tables=tables,
        has_views=bool(views),
        plotly=get_plotlyjs(),
        figure=script_safe(figure.to_json()),
        data=script_safe(json.dumps(data)),
    )


def _layout(unit: str, bounds: NDArray, up: Up) -> dict:
    """Return the figure's axes, first eye and colours."""
    eye = up.eye_direction(*EYE) * 2.15
    ticks = _ticks(bounds)
    axes = {
        f"{name}axis": {
            "title": {"text": f"{name} ({html.escape(unit)})"},
            "range": bounds[:, number].tolist(),
            "backgroundcolor": "#f7f8fa",
            "gridcolor": "#dde2e7",
            "zerolinecolor": "#c3cad1",
            "exponentformat": "none",
            "nticks": ticks[name],
        }
        for number, name in enumerate("xyz")
    }
    return {
        "scene": {
            **axes,
            "aspectmode": "manual",
            "aspectratio": _aspect(bounds),
            "camera": {
                "center": dict(zip("xyz", (-0.08 * up.vector).tolist(), strict=True)),
                "eye": dict(zip("xyz", eye.tolist(), strict=True)),
                "up": dict(zip("xyz", up.vector.tolist(), strict=True)),
            },
        },
        "showlegend": False,
        "margin": {"l": 0, "r": 0, "t": 0, "b": 0},
        "template": "plotly_white",
        "font": {"color": "#1b2733"},
    }


def _layer(scene: Scene, group: str, visible: bool, traces: list[int]) -> dict:
    """Return the page's data of a group."""
    parts: list[Mesh | Label] = [*scene.meshes, *scene.labels]
    scale = next((mesh.scale for mesh in scene.meshes if mesh.group == group), None)
    if scale is None:
        own = (css(part.colour) for part in parts if part.group == group)
        colours = list(dict.fromkeys(own))
    else:
        colours = [colour for _, colour in steps(scale)]
    return {
        "name": group,
        "traces": traces,
        "visible": visible,
        "colours": colours,
        "gradient": scale is not None,
        "exclusive": group.startswith(MAP),
    }


def _aspect(bounds: NDArray) -> dict[str, float]:
    """Return the lengths of the drawn axes, to scale, for a box ``bounds`` ``(2, 3)``."""
    extent = np.maximum(np.ptp(bounds, axis=0), 1e-300)
    return dict(zip("xyz", (1.3 * extent / extent.max()).tolist(), strict=True))


def _ticks(bounds: NDArray) -> dict[str, int]:
    """Return how many numbers each drawn axis has room for."""
    return {name: max(4, round(8 * length)) for name, length in _aspect(bounds).items()}


def _zooms(bounds: NDArray, grid: VoxelGrid) -> list[dict]:
    """Return two sets of axis ranges: everything, or the box and a little around."""
    zooms = []
    for label, box in (("Whole rig", bounds), ("Volume", _around(grid))):
        change = {f"scene.{name}axis.range": box[:, a].tolist() for a, name in enumerate("xyz")}
        change |= {f"scene.{name}axis.nticks": n for name, n in _ticks(box).items()}
        zooms.append({"label": label, "change": {**change, "scene.aspectratio": _aspect(box)}})
    return zooms


def _around(grid: VoxelGrid) -> NDArray[np.float64]:
    """Return the box with a little around it, ``(2, 3)``."""
    margin = 0.15 * float(np.linalg.norm(grid.extent))
    return np.stack([grid.lower - margin, grid.upper + margin])
