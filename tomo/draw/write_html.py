"""Write a scene as one interactive HTML page that works without a network."""

from __future__ import annotations

import json
import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from rigs.files import atomic_path
from tomo.draw.page import render, script_safe
from tomo.draw.rig.camera_view import CameraView
from tomo.draw.scene import Scene
from tomo.draw.stage import stage
from tomo.grid import VoxelGrid


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
    path: str | os.PathLike,
    scene: Scene,
    *,
    title: str = "",
    views: Sequence[CameraView] = (),
    tables: Sequence[Table] = (),
    grid: VoxelGrid | None = None,
    leave_out: tuple[str, ...] = ("stems",),
    **shown: Any,
) -> None:
    """Write the page: every group is a layer to switch on and off, the pointer shows names.

    Parameters
    ----------
    path : path-like
    scene : Scene
    title : str
        Title of the page; plain text.
    views : sequence of CameraView
        Adds a panel of their pictures; a pixel clicked there shows its ray.
    tables : sequence of Table
        Tables below the scene.
    grid : VoxelGrid, optional
        Adds buttons that show the whole scene or the box alone.
    leave_out : tuple of str
        Groups not to show.
    shown
        Further arguments of `stage`.
    """
    box = None if grid is None else [grid.lower.tolist(), grid.upper.tolist()]
    seen = json.dumps({"views": [view.data() for view in views], "box": box}) if views else ""
    one = stage(scene.without(*leave_out), grid=grid, rays=bool(views), **shown)
    write_page(path, one, title=title, tables=tables, views=script_safe(seen))


def write_page(
    path: str | os.PathLike,
    stage: Mapping[str, Any],
    *,
    title: str = "",
    tables: Sequence[Table] = (),
    views: str = "",
) -> None:
    """Write the page of a `stage`; ``views`` is the JSON of the panel of cameras, if any."""
    text = render("scene.html", title=title or "Scene", stage=stage, tables=tables, views=views)
    with atomic_path(path) as temporary:
        temporary.write_text(text, encoding="utf-8")
