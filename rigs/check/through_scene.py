"""What a rig's scene does to its views: hidden pixels, windows looked through, colours."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from rigs.check.resolved_wavelength import short
from rigs.check.result import Finding, RigCheck
from rigs.files.text import some
from rigs.scene import Glass, Scene, SceneCamera, Window
from rigs.scene.tracing import OPEN

_LATTICE = 48  # pixels along each side of an image that are asked what they see
_ABBE = 60.0
"""Abbe's number of crown glass: quartz has 68, BK7 64, acrylic 57, water 56."""

_COLOURS = 450.0, 700.0
"""Ends of the band in nm over which a flame's light is compared."""


def hardware(check: RigCheck) -> Iterator[Finding]:
    """Find cameras of which hardware fills part of the image."""
    found = {
        camera.name: hidden_pixels(camera, check.coverage.points) for camera in _through(check)
    }
    found = {name: own for name, own in found.items() if own[0] >= 0.005}  # less is a rim
    if not found:
        return
    shares = [share for share, _ in found.values()]
    seen = sum((counts for _, counts in found.values()), Counter())
    named = some(name for name, _ in seen.most_common())
    low, high = f"{min(shares):.0%}", f"{max(shares):.0%}"
    yield Finding(
        "warning" if max(shares) > 0.1 else "note",
        f"{low if low == high else f'{low} to {high}'} of the image is hardware ({named}): "
        "its pixels take no part",
        tuple(found),
    )


def glass(check: RigCheck) -> Iterator[Finding]:
    """Find by how much glass shifts the lines of sight, and how much that depends on colour."""
    middle = check.coverage.points.mean(axis=0)
    shifts = [
        (camera.name, shift) for camera in _through(check) if (shift := shift_at(camera, middle))
    ]
    largest = max((shift.length for _, shift in shifts), default=0.0)
    if not largest >= 0.1 * check.voxel:
        return
    unit = check.coverage.rig.length_unit
    angles = [shift.angle for _, shift in shifts if np.isfinite(shift.angle)]
    names = tuple(name for name, _ in shifts)
    text = f"glass shifts lines of sight by up to {largest:.2g} {unit}"
    text += f" ({short(largest / check.voxel)} voxels)"
    if angles:
        text += f", at up to {max(angles):.0f} degrees from a window's normal"
    yield Finding("note", text, names)
    colour = max(shift.by_colour for _, shift in shifts)
    if colour >= 0.1 * check.voxel:
        yield Finding(
            "warning" if colour > check.voxel else "note",
            f"the shift differs by {colour:.2g} {unit} ({short(colour / check.voxel)} voxels) "
            f"between {_COLOURS[0]:.0f} and {_COLOURS[1]:.0f} nm: give the index at the colour "
            "of the images, or use a filter",
            names,
        )


def gas(check: RigCheck) -> Iterator[Finding]:
    """Find gas whose index is doubtful."""
    scene = check.coverage.rig.scene
    if scene is not None and scene.gas is not None and scene.gas.index is not None:
        for line in scene.gas.index.warnings():
            yield Finding("warning", line)


@dataclass(frozen=True)
class Shift:
    """How glass moves the line of sight through the volume's middle."""

    length: float  # distance of the middle from the straight line of the same pixel
    by_colour: float  # difference of the lengths between the ends of the visible band
    angle: float  # degrees, to the normal of the first window on the way; NaN without


def shift_at(camera: SceneCamera, point: NDArray[np.float64]) -> Shift | None:
    """Return the shift of the line of sight through a point; None without glass, or hidden.

    The index falls with the wavelength as ``A + B / w²`` (Cauchy), with the ``B`` that Abbe's
    number gives between 486 and 656 nm.
    """
    uv, _, valid = camera.project(point[None])
    solids = camera.scene.solids
    if not valid[0] or not any(isinstance(solid.material, Glass) for solid in solids):
        return None
    paths, _ = camera.paths(uv)
    last = int(paths.nearest_pieces(point)[0])
    ends = [None if number < 0 else solids[number] for number in paths.solids[:last]]  # gas: none
    if not any(solid is not None and isinstance(solid.material, Glass) for solid in ends):
        return None
    angles = [
        np.degrees(np.arccos(min(abs(float(np.dot(direction, solid.normal))), 1.0)))
        for direction, solid in zip(paths.directions[:last], ends, strict=True)
        if isinstance(solid, Window)
    ]
    slope = 1 / (_ABBE * (486.1**-2 - 656.3**-2))  # of (n - 1) times 1 / w²

    def bent(colour: float) -> Scene:
        change = slope * (colour**-2 - 589.3**-2)
        return _with_indices(camera.scene, lambda index: 1 + (index - 1) * (1 + change))

    places = [_passes(camera, uv, bent(colour), point) for colour in _COLOURS]
    straight = _passes(
        camera, uv, _with_indices(camera.scene, lambda index: camera.scene.medium), point
    )
    by_colour = float(np.linalg.norm(places[0] - places[1]))
    angle = angles[0] if angles else np.nan  # later faces are met inside the glass
    return Shift(float(np.linalg.norm(straight - point)), by_colour, angle)


def hidden_pixels(camera: SceneCamera, points: NDArray[np.float64]) -> tuple[float, Counter]:
    """Return which fraction of pixels sees nothing of the points' box, and how often which solid.

    Only pixels whose line of sight ends count: others look past the volume.
    """
    region = np.stack([points.min(axis=0), points.max(axis=0)])
    axes = [np.linspace(0, side - 1, min(side, _LATTICE)).round() for side in camera.image_size]
    uv = np.stack(np.meshgrid(*axes), axis=-1).reshape(-1, 2)
    whole, _ = camera.paths(uv)
    if not len(whole):
        return 0.0, Counter()
    inside, _ = camera.paths(uv, region)
    hidden = (whole.ends != OPEN) & (np.diff(inside.ray_ptr) == 0)
    last = whole.solids[whole.ray_ptr[1:] - 1][hidden]
    names = (camera.scene.solids[number].name for number in last if number >= 0)
    return float(hidden.mean()), Counter(names)


def _through(check: RigCheck) -> list[SceneCamera]:
    """Return the cameras that look through a scene."""
    return [camera for camera in check.coverage.rig if not camera.is_straight]


def _passes(
    camera: SceneCamera, uv: NDArray[np.float64], scene: Scene, point: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return where a pixel's path through another scene passes a point most closely."""
    paths, _ = replace(camera, scene=scene).paths(uv)
    piece = int(paths.nearest_pieces(point)[0])
    origin, direction = paths.origins[piece], paths.directions[piece]
    return origin + ((point - origin) @ direction) * direction


def _with_indices(scene: Scene, change: Callable[[float], float]) -> Scene:
    """Return the scene with other indices of its glass and of the media in it."""
    solids = []
    for solid in scene.solids:
        new = {}
        if isinstance(solid.material, Glass):
            new["material"] = replace(solid.material, index=change(solid.material.index))
        for name in ("beyond", "inside"):
            if getattr(solid, name, None) is not None:
                new[name] = change(getattr(solid, name))
        solids.append(replace(solid, **new) if new else solid)
    return replace(scene, solids=tuple(solids))
