"""What a page shows of a scene and of the light of a volume: plain data for its script."""

from __future__ import annotations

import base64
import json
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import cached_property, reduce
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from tomo.draw.emission import EYE, LIGHT, Looks, brightest_integral, emission_image, of_integral
from tomo.draw.figures import raised, with_unit
from tomo.draw.frame import EYE as RIG_EYE
from tomo.draw.frame import UP, Up, Viewpoint
from tomo.draw.page import embedded, script_safe, small_png
from tomo.draw.raster import render
from tomo.draw.scene import ColourScale, Label, Mesh, Scene, css
from tomo.draw.shapes import box_corners
from tomo.draw.volume.isosurface import LEVELS, coarsened, finite, reference_value
from tomo.draw.volume.planes import MAP
from tomo.grid import Volume, VoxelGrid

RAYS, RAY_COLOUR = "clicked rays", "#ff5fc4"
"""The layer of the rays of pixels that the reader clicked."""

HIDDEN_AT_FIRST = ("arrow names", "other names", "field of view", "images")

_ORDER = (
    "light", "surfaces", "plane x", "plane y", "plane z", "cameras", "names", "images",
    "sight lines", "field of view", "arrows", "arrow names", "other cameras", "other names",
    "moved", "targets", "target names", RAYS, "box",
)  # fmt: skip
"""Layers that come first in the list; the others follow in the order of the scene."""

COLOUR_MAPS = ("inferno", "viridis", "magma", "turbo", "gray")
"""Colour maps to choose from in a page."""

MOST_VOXELS = 8_000_000
"""Voxels of all frames of a page, four thirds of a byte each: larger volumes are shown by means of
blocks. Lower: films lose details; higher: pages take long to load."""

_STILL = (480, 480)  # pixels of the picture where the page's script cannot draw


@dataclass(frozen=True, eq=False)
class Shown:
    """A volume, or the volumes of a film, on one grid, as a page shows them."""

    frames: Sequence[Volume]
    moments: Sequence[tuple[str, float]] = ()  # label, and 0 to 1 along the time axis, of frames
    looks: Looks = LIGHT
    up: Up = UP
    whole: VoxelGrid | None = None  # of the volumes before they were made coarser
    scale: tuple[float, float] | None = None  # ends where there are more frames than these

    @cached_property
    def small(self) -> list[Volume]:
        """The frames, coarse enough that all of them fit into a page."""
        return [fitting(one, len(self.frames)) for one in self.frames]

    @cached_property
    def ends(self) -> tuple[float, float]:
        """The largest value and the brightest integral: the ends of both colour scales."""
        return self.scale or scale_of(self.small, self.up)


def fitting(volume: Volume, count: int = 1) -> Volume:
    """Return a volume coarse enough that ``count`` of them fit into a page; no NaN is left."""
    return coarsened(finite(volume), max(MOST_VOXELS // count, 1))


def stage(
    scene: Scene,
    *,
    up: Up | None = None,
    grid: VoxelGrid | None = None,
    shown: Shown | None = None,
    moments: Sequence[tuple[str, float]] = (),
    visible: Sequence[str] = (),
    hidden: Sequence[str] = HIDDEN_AT_FIRST,
    close_up: bool = False,
    turning: bool = False,
    rays: bool = False,
    note: str = "",
) -> dict[str, Any]:
    """Return what the template of a stage needs: ``data`` as JSON, and a still picture.

    A ``grid`` adds buttons that show the whole scene or the box alone. ``moments``, label and
    position, replace those of ``shown``: of images alone, or of frames fetched later. ``visible``
    and ``hidden`` groups are so at first. The view starts ``close_up`` on the box, or ``turning``
    once. With ``rays``, pixels of camera images are clicked. ``note`` is below the controls.
    """
    up, scene = up or (shown.up if shown else UP), scene.on_black()
    if shown is not None:
        grid = shown.frames[0].grid
    bounds = np.stack([grid.lower, grid.upper]) if grid is not None and shown else scene.bounds
    if scene.meshes:
        both = np.stack([bounds, scene.bounds])
        bounds = np.stack([both.min(axis=(0, 1)), both.max(axis=(0, 1))])
    origin = np.asarray(grid.center if grid is not None else bounds.mean(axis=0))
    lone = "cameras" not in scene.groups
    azimuth, elevation = EYE if lone else RIG_EYE
    volume, coarser = _volume(shown, origin, scene.length_unit) if shown else (None, "")
    layers = _layers(scene, visible, hidden, shown, rays)
    on = {layer["name"] for layer in layers if layer["visible"]}
    zooms = _zooms(bounds - origin, grid, "cameras" in scene.groups, "arrows" in on)
    moments = moments or (() if shown is None else shown.moments)
    data = {
        "meshes": [part for group in scene.groups for part in _meshes(scene, group, origin)],
        "labels": [
            {
                "text": label.text,
                "layer": label.group,
                "position": (label.position - origin).tolist(),
                "outward": label.outward.tolist(),
                "colour": css(label.colour),
            }
            for label in scene.labels
        ],
        "layers": layers,
        "zooms": zooms,
        "zoom": len(zooms) - 1 if close_up else 0,
        "volume": volume,
        "palettes": {name: _palette(name) for name in (shown.looks.colours, *COLOUR_MAPS)}
        if shown
        else {},
        "moments": [{"label": label, "at": at} for label, at in moments],
        "origin": origin.tolist(),
        "unit": scene.length_unit,
        "up": {"axis": up.axis, "sign": up.sign},
        "azimuth": azimuth,
        "elevation": elevation,
        "reach": float(np.linalg.norm(np.ptp(bounds, axis=0))),
        "turning": turning,
        "note": f"{note} {coarser}".strip(),
    }
    box = np.array(zooms[data["zoom"]]["box"]) + origin
    picture = _still(scene.only(on), shown, box, up, (azimuth, elevation))
    return {"data": script_safe(json.dumps(data)), "still": embedded(small_png(picture))}


def _volume(shown: Shown, origin: NDArray, unit: str) -> tuple[dict[str, Any], str]:
    """Return the frames as bytes on one scale, and words on what was made coarser or cut."""
    first, grid, (highest, full) = shown.frames[0], shown.small[0].grid, shown.ends
    whole, value_unit, words = shown.whole or first.grid, first.value_unit, ""
    if grid != whole:
        fine, shape = (" x ".join(map(str, one.shape)) for one in (whole, grid))
        words = f"Shown on {shape} voxels, means of blocks of the volume's {fine}."
    return {
        "shape": grid.shape,
        "lower": (grid.lower - origin).tolist(),
        "extent": grid.extent.tolist(),
        "frames": [_base64(in_steps(frame, highest)) for frame in shown.small],
        "highest": highest,
        "full": full,
        "levels": shown.looks.levels or LEVELS[:2],
        "colours": _palette(shown.looks.colours),
        "unit": raised(value_unit),
        "quantity": with_unit("emission", value_unit),
        "integral_unit": of_integral(value_unit, unit),
    }, words


def scale_of(frames: Iterable[Volume], up: Up) -> tuple[float, float]:
    """Return the largest value of volumes, 1 where they are dark, and the brightest integral."""
    found = [(reference_value(frame), brightest_integral(frame, up)) for frame in frames]
    highest, full = np.max(found, axis=0).tolist()
    return highest or 1.0, full


def in_steps(frame: NDArray, highest: float) -> NDArray[np.uint8]:
    """Return a volume as a page holds it: 255 steps from zero to the largest value."""
    return np.clip(np.round(frame * (255 / highest)), 0, 255).astype(np.uint8)


def _layers(
    scene: Scene, visible: Sequence[str], hidden: Sequence[str], shown: Shown | None, rays: bool
) -> list[dict[str, Any]]:
    """Return the page's switches in their order, with the colours that tell them apart."""
    layers = []
    for group in scene.groups:
        everything: list[Mesh | Label] = [*scene.meshes, *scene.labels]
        parts = [part for part in everything if part.group == group]
        scale = next((part.scale for part in parts if isinstance(part, Mesh) and part.scale), None)
        colours = list(dict.fromkeys(css(part.colour) for part in parts))
        layers.append(
            {
                "name": group,
                "visible": group in visible or not (group in hidden or group.startswith(MAP)),
                "colours": _steps(scale.colours) if scale else colours,
                "gradient": scale is not None,
                "exclusive": group.startswith(MAP),
            }
        )
    plain = {"visible": False, "gradient": True, "exclusive": False}
    if shown:
        names = ("light", "surfaces", "plane x", "plane y", "plane z")
        own = [{**plain, "name": name, "colours": _steps(shown.looks.colours)} for name in names]
        first = 1 if shown.looks.levels else 0
        own[first]["visible"] = not any(group.startswith(MAP) for group in visible)
        layers += own
    if rays:
        layers.append({**plain, "name": RAYS, "visible": True, "colours": [RAY_COLOUR] * 2})
    return sorted(layers, key=lambda layer: (*_ORDER, layer["name"]).index(layer["name"]))


def _meshes(scene: Scene, group: str, origin: NDArray) -> list[dict[str, Any]]:
    """Return one part of the page's data for all meshes of a group that look alike."""
    looks: dict[tuple, list[Mesh]] = {}
    for mesh in scene.meshes:
        if mesh.group == group and len(mesh.triangles):
            looks.setdefault((mesh.colour, mesh.opacity, mesh.scale), []).append(mesh)
    made = []
    for alike in looks.values():
        whole = reduce(Mesh.merged, alike)
        part = {
            "group": group,
            "names": [mesh.name for mesh in alike],
            "counts": [len(mesh.vertices) for mesh in alike],
            "colour": whole.colour,
            "opacity": whole.opacity,
            "vertices": _base64((whole.vertices - origin).astype(np.float32)),
            "triangles": _base64(whole.triangles.astype(np.uint32)),
        }
        if whole.scale is not None and whole.values is not None:
            low, high = whole.scale.lower, whole.scale.upper
            share = np.clip((np.asarray(whole.values, np.float64) - low) / (high - low), 0, 1)
            steps = np.where(np.isfinite(share), np.round(1 + 254 * np.nan_to_num(share)), 0)
            part |= {
                "values": _base64(steps.astype(np.uint8)),
                "palette": _palette(whole.scale.colours),
                "span": [low, high],
                "title": whole.scale.title,
            }
        made.append(part)
    return made


def _zooms(
    bounds: NDArray, grid: VoxelGrid | None, has_cameras: bool, has_arrows: bool
) -> list[dict[str, Any]]:
    """Return the boxes to look at, about the origin: everything, and the volume's."""
    whole = {"label": "Whole rig" if has_cameras else "Whole view", "box": bounds.tolist()}
    if grid is None or not has_cameras:
        return [whole]
    margin = (0.15 if has_arrows else 0.02) * float(np.linalg.norm(grid.extent))
    half = grid.extent / 2 + margin
    return [whole, {"label": "Volume", "box": [(-half).tolist(), half.tolist()]}]


def _still(
    scene: Scene, shown: Shown | None, box: NDArray, up: Up, eye: tuple[float, float]
) -> NDArray[np.uint8]:
    """Return the first view without a script: the triangles, and the light over them."""
    viewpoint = Viewpoint.framing(
        box_corners(*box), up.eye_direction(*eye), up.vector, _STILL, distance=6
    )
    picture = render(scene, viewpoint, supersample=1, ground=(0.0, 0.0, 0.0))
    if shown is not None:
        scale = ColourScale("", 0.0, shown.ends[1], shown.looks.colours)
        picture = picture + scale(emission_image(shown.small[0], viewpoint)).astype(np.float32)
    return np.clip(255 * picture, 0, 255).astype(np.uint8)


def _palette(colours: str) -> str:
    scale = ColourScale("", 0.0, 1.0, colours)
    return _base64(np.round(255 * scale(np.linspace(0, 1, 256))).astype(np.uint8))


def _steps(colours: str) -> list[str]:
    scale = ColourScale("", 0.0, 1.0, colours)
    return [css(tuple(colour)) for colour in scale(np.linspace(0, 1, 9))]


def _base64(values: ArrayLike) -> str:
    array = np.ascontiguousarray(values)
    little = array.astype(array.dtype.newbyteorder("<"), copy=False)
    return base64.b64encode(little.tobytes()).decode("ascii")
