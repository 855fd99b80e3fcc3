"""Write a scene as one interactive HTML page that works without a network (plotly inlined)."""

from __future__ import annotations

import html
import os
from functools import reduce
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from tomo.grid import VoxelGrid
from tomo.io.atomic import atomic_path
from tomo.view.frame import EYE, Up
from tomo.view.scene import Colour, Label, Mesh, Scene

if TYPE_CHECKING:
    import plotly.graph_objects as go

_HIDDEN_AT_FIRST = ("arrow names", "slices")
_PAGE = """<!DOCTYPE html>
<html lang="en">
<head>
<meta charset="utf-8">
<meta name="viewport" content="width=device-width, initial-scale=1">
<title>{title}</title>
<style>
html, body {{ margin: 0; height: 100%; background: #fff; overflow: hidden;
  font-family: system-ui, sans-serif; }}
body > div {{ height: 100vh; }}
</style>
</head>
<body>
{figure}
</body>
</html>
"""


def write_html(
    path: str | os.PathLike,
    scene: Scene,
    *,
    title: str = "",
    up: Up | None = None,
    grid: VoxelGrid | None = None,
    volume: NDArray | None = None,
    leave_out: tuple[str, ...] = ("stems",),
) -> None:
    """Write the page: groups switch on and off in the legend, hovering tells names.

    Parameters
    ----------
    path : path-like
    scene : Scene
    title : str
        Of the page; plain text.
    up : Up, optional
        Which axis points upward.
    grid : VoxelGrid, optional
        Adds buttons that show the whole rig or the box alone.
    volume : (nx, ny, nz), optional
        Adds its three middle planes, switched off at first.
    leave_out : tuple of str
        Groups not to show.
    """
    import plotly.graph_objects as go

    up = up or Up()
    scene = scene.without(*leave_out)
    traces = [trace for group in scene.groups for trace in _group_traces(scene, group)]
    if volume is not None and grid is not None:
        traces += _slices(volume, grid)
    figure = go.Figure(traces)
    eye = up.eye_direction(*EYE) * 2.0
    ticks = _ticks(scene.bounds)
    axes = {
        f"{name}axis": {
            "title": {"text": f"{name} ({html.escape(scene.length_unit)})"},
            "backgroundcolor": "#f7f8fa",
            "gridcolor": "#dde2e7",
            "zerolinecolor": "#c3cad1",
            "exponentformat": "none",
            "nticks": ticks[name],
        }
        for name in "xyz"
    }
    figure.update_layout(
        title={"text": html.escape(title), "x": 0.02, "font": {"size": 18}},
        scene={
            **axes,
            "aspectmode": "manual",
            "aspectratio": _aspect(scene.bounds),
            "camera": {
                "center": dict(zip("xyz", (-0.08 * up.vector).tolist(), strict=True)),
                "eye": dict(zip("xyz", eye.tolist(), strict=True)),
                "up": dict(zip("xyz", up.vector.tolist(), strict=True)),
            },
        },
        legend={"itemsizing": "constant", "groupclick": "togglegroup", "x": 1.0, "y": 0.95},
        margin={"l": 0, "r": 0, "t": 60, "b": 0},
        template="plotly_white",
        font={"color": "#1b2733"},
        updatemenus=_buttons(scene, grid)
        if grid is not None and "cameras" in scene.groups
        else [],
    )
    body = figure.to_html(
        full_html=False,
        include_plotlyjs=True,
        include_mathjax=False,
        default_height="100%",
        config={"displaylogo": False, "responsive": True},
        div_id="scene",
    )
    with atomic_path(path) as temporary:
        text = _PAGE.format(title=html.escape(title or "Scene"), figure=body)
        temporary.write_text(text, encoding="utf-8")


def _css(colour: Colour) -> str:
    """Return the colour as CSS."""
    return "rgb({:.0f},{:.0f},{:.0f})".format(*(255 * c for c in colour))


def _group_traces(scene: Scene, group: str) -> list[go.Mesh3d | go.Scatter3d]:
    """Return one trace for all meshes of a group that look alike, and one for its labels."""
    import plotly.graph_objects as go

    meshes = [mesh for mesh in scene.meshes if mesh.group == group and len(mesh.triangles)]
    labels = [label for label in scene.labels if label.group == group]
    looks: dict[tuple, list[Mesh]] = {}
    for mesh in meshes:
        looks.setdefault((mesh.colour, mesh.opacity), []).append(mesh)
    shared = {
        "name": html.escape(group),
        "legendgroup": group,
        "visible": "legendonly" if group in _HIDDEN_AT_FIRST else True,
    }
    traces = []
    for (colour, opacity), alike in looks.items():
        together = reduce(Mesh.merged, alike)
        names = [html.escape(mesh.name) for mesh in alike for _ in range(len(mesh.vertices))]
        x, y, z = np.float32(together.vertices).T
        i, j, k = np.int32(together.triangles).T
        traces.append(
            go.Mesh3d(
                x=x, y=y, z=z, i=i, j=j, k=k,
                color=_css(colour),
                opacity=opacity,
                text=names if len(alike) > 1 else names[0],
                hovertemplate="%{text}<extra></extra>",
                lighting={"ambient": 0.65, "diffuse": 0.5, "specular": 0.08},
                showlegend=not traces,
                **shared,
            )
        )  # fmt: skip
    if labels:
        traces.append(_label_trace(labels, {**shared, "showlegend": not traces}))
    return traces


def _label_trace(labels: list[Label], shared: dict) -> go.Scatter3d:
    """Return the labels as texts at their points."""
    import plotly.graph_objects as go

    x, y, z = np.array([label.position + label.outward for label in labels]).T
    return go.Scatter3d(
        x=x, y=y, z=z,
        mode="text",
        text=[html.escape(label.text) for label in labels],
        textposition="middle center",
        textfont={"size": 11, "color": [_css(label.colour) for label in labels]},
        hoverinfo="skip",
        **shared,
    )  # fmt: skip


def _slices(volume: NDArray, grid: VoxelGrid) -> list[go.Surface]:
    """Return the three middle planes, coloured by value."""
    import plotly.graph_objects as go

    surfaces = []
    axes = grid.axes()
    highest = float(np.nanmax(volume)) or 1.0
    for axis in range(3):
        u, v = (a for a in range(3) if a != axis)
        first, second = np.meshgrid(axes[u], axes[v], indexing="ij")
        points = [None, None, None]
        points[u], points[v] = first, second
        points[axis] = np.full_like(first, grid.center[axis])
        values = np.float32(np.take(volume, grid.shape[axis] // 2, axis=axis))
        surfaces.append(
            go.Surface(
                x=points[0], y=points[1], z=points[2],
                surfacecolor=values,
                cmin=0.0,
                cmax=highest,
                colorscale="Inferno",
                showscale=axis == 0,
                colorbar={"title": {"text": "emission"}, "len": 0.5, "x": 0.0, "y": 0.5},
                name="slices",
                legendgroup="slices",
                showlegend=axis == 0,
                visible="legendonly",
                hovertemplate="%{surfacecolor:.4g}<extra></extra>",
            )
        )  # fmt: skip
    return surfaces


def _aspect(bounds: NDArray) -> dict[str, float]:
    """Return the lengths of the drawn axes, to scale, for a box ``bounds`` ``(2, 3)``."""
    extent = np.maximum(np.ptp(bounds, axis=0), 1e-300)
    return dict(zip("xyz", (1.3 * extent / extent.max()).tolist(), strict=True))


def _ticks(bounds: NDArray) -> dict[str, int]:
    """Return how many numbers each drawn axis has room for."""
    return {name: max(4, round(8 * length)) for name, length in _aspect(bounds).items()}


def _buttons(scene: Scene, grid: VoxelGrid) -> list[dict]:
    """Return two buttons that set the axes' ranges: everything, or the box and a little around."""
    whole = scene.bounds
    margin = 0.15 * float(np.linalg.norm(grid.extent))
    close = np.stack([grid.lower - margin, grid.upper + margin])
    buttons = []
    for label, bounds in (("Whole rig", whole), ("Volume", close)):
        ranges = {f"scene.{name}axis.range": bounds[:, a].tolist() for a, name in enumerate("xyz")}
        ticks = {f"scene.{name}axis.nticks": n for name, n in _ticks(bounds).items()}
        change = {**ranges, **ticks, "scene.aspectratio": _aspect(bounds)}
        buttons.append({"label": label, "method": "relayout", "args": [change]})
    place = {"type": "buttons", "direction": "right", "x": 0.02, "y": 1.0}
    return [{**place, "xanchor": "left", "yanchor": "top", "buttons": buttons}]
