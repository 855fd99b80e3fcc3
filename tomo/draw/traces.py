"""A scene's meshes as plotly's traces."""

from __future__ import annotations

import html
from functools import reduce
from typing import TYPE_CHECKING

import numpy as np

from tomo.draw.scene import Colour, ColourScale, Mesh, Scene

if TYPE_CHECKING:
    import plotly.graph_objects as go

RAYS = "clicked rays"
"""The layer of the rays of pixels that the reader clicked."""

RAY_COLOUR = "#d4148c"


def group_traces(scene: Scene, group: str, visible: bool) -> list[go.Mesh3d]:
    """Return one trace for all meshes of a group that look alike."""
    meshes = [mesh for mesh in scene.meshes if mesh.group == group and len(mesh.triangles)]
    looks: dict[tuple, list[Mesh]] = {}
    for mesh in meshes:
        looks.setdefault((mesh.colour, mesh.opacity, mesh.scale), []).append(mesh)
    return [
        _trace(alike, group, visible, first=number == 0)
        for number, alike in enumerate(looks.values())
    ]


def _trace(alike: list[Mesh], group: str, visible: bool, first: bool) -> go.Mesh3d:
    """Return the trace of meshes that look alike; hovering shows the mesh's name."""
    import plotly.graph_objects as go

    together = reduce(Mesh.merged, alike)
    names = [html.escape(mesh.name) for mesh in alike for _ in range(len(mesh.vertices))]
    x, y, z = together.vertices.astype(np.float32).T
    i, j, k = together.triangles.astype(np.int32).T
    shared = {
        "x": x, "y": y, "z": z, "i": i, "j": j, "k": k,
        "opacity": together.opacity,
        "name": html.escape(group),
        "visible": visible,
        "text": names if len(alike) > 1 else names[0],
    }  # fmt: skip
    scale, values = together.scale, together.values
    if scale is None or values is None:
        return go.Mesh3d(
            color=css(together.colour),
            hovertemplate="%{text}<extra></extra>",
            lighting={"ambient": 0.65, "diffuse": 0.5, "specular": 0.08},
            **shared,
        )
    return go.Mesh3d(
        intensity=values.astype(np.float32),
        cmin=scale.lower,
        cmax=scale.upper,
        colorscale=steps(scale),
        showscale=first and bool(scale.title),
        colorbar={
            "title": {"text": html.escape(scale.title), "side": "right"},
            "len": 0.5, "thickness": 14, "x": 0.01, "xanchor": "left", "y": 0.3,
        },
        lighting={"ambient": 1.0, "diffuse": 0.0, "specular": 0.0, "fresnel": 0.0},
        hovertemplate="%{text}<br>%{intensity:.4g}<extra></extra>"
        if scale.title
        else "%{text}<extra></extra>",
        **shared,
    )  # fmt: skip


def no_rays() -> go.Scatter3d:
    """Return the trace that the page fills with rays."""
    import plotly.graph_objects as go

    return go.Scatter3d(
        x=[], y=[], z=[],
        mode="lines",
        line={"color": RAY_COLOUR, "width": 5},
        name=RAYS,
        hoverinfo="skip",
        visible=True,
    )  # fmt: skip


def css(colour: Colour) -> str:
    """Return the colour as CSS."""
    return "rgb({:.0f},{:.0f},{:.0f})".format(*(255 * c for c in colour))


def steps(scale: ColourScale, count: int = 17) -> list[tuple[float, str]]:
    """Return a colour scale in plotly's form."""
    fractions = np.linspace(0, 1, count)
    colours = scale(scale.lower + fractions * (scale.upper - scale.lower))
    return [(float(s), css(c)) for s, c in zip(fractions, colours, strict=True)]
