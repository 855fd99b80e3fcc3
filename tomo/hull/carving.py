"""Dark pixels, and the voxels that they prove empty."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from numbers import Integral, Real
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from tomo.grid import ActiveVoxels, VoxelGrid
from tomo.hull.darkness import Brightness
from tomo.hull.margins import (
    CARVED_AWAY,
    UNEXPLAINED,
    Hull,
    Hulls,
    margins_to_try,
    smallest,
    votes_to_try,
)
from tomo.hull.projection_lattice import Lattice
from tomo.measurement import NoiseModel, check_sizes

if TYPE_CHECKING:
    from rigs import CameraLike


@dataclass(frozen=True, eq=False)
class Carving:
    """The voxels that can be non-zero, and how they were found."""

    active: ActiveVoxels
    pixels: tuple[NDArray[np.bool_], ...]
    """For each view the usable pixels that may see an active voxel, ``(height, width)``."""
    margin: float  # pixels by which a voxel's image was grown before it was tested
    threshold: float  # the intensity up to which a pixel counts as dark
    smoothing: float  # standard deviation, in pixels, of the blur before that; 0 for none
    votes: int  # views that had to find a voxel dark
    unexplained: float  # largest fraction, over views, of bright light that meets no active voxel
    light_carved_away: float  # fraction of all images' light, however faint, that meets none
    faint_light: float  # that fraction at the smallest margin tried
    noise: tuple[NoiseModel, ...]  # one a view
    reason: str  # why these voxels were carved, in words
    dark: bool = False  # no pixel is certainly bright: the images say nothing of the voxels

    @property
    def warnings(self) -> list[str]:
        """A line where faint light would have been carved away, or was."""
        if self.light_carved_away > CARVED_AWAY:
            return [
                f"carving: {self.light_carved_away:.1%} of the light meets no voxel that was "
                "kept: it is missing in the volume. Let the margin be chosen (carving: auto), or "
                "keep all voxels (--no-skip)"
            ]
        if self.faint_light <= CARVED_AWAY:
            return []
        kept = "all voxels were kept" if self.active.all else f"{self.margin:g} pixels around it"
        return [
            f"faint light around the flame, {self.faint_light:.1%} of all, was kept: {kept}. If "
            "it is no emission but reflections or a background, subtract it as a dark level, "
            "or mask it"
        ]

    def report(self, names: Sequence[str]) -> dict[str, Any]:
        """Return plain numbers and words for report.json; ``names`` are the cameras'."""
        return {
            "active_voxels": self.active.size,
            "voxels": self.active.grid.size,
            "pixels": int(sum(np.count_nonzero(kept) for kept in self.pixels)),
            "margin": self.margin,
            "threshold": self.threshold,
            "smoothing": self.smoothing,
            "votes": self.votes,
            "unexplained": self.unexplained,
            "light_carved_away": self.light_carved_away,
            "noise": {
                name: {"read": one.read, "gain": one.gain}
                for name, one in zip(names, self.noise, strict=True)
            },
            "reason": self.reason,
        }


def carve(
    cameras: Sequence[CameraLike],
    images: Sequence[NDArray[np.floating]],
    masks: Sequence[NDArray[np.bool_]] | None,
    grid: VoxelGrid,
    *,
    margin: float | str = "auto",
    threshold: float | str = "auto",
    votes: int | str = "auto",
    views: Sequence[int] | None = None,
    noise: Sequence[NoiseModel] | None = None,
) -> Carving:
    """Find the voxels that dark pixels prove empty.

    A view finds a voxel dark when its projected box, grown by the ``margin`` in pixels by which
    the cameras may point wrongly, touches no pixel above the ``threshold``, which comes from the
    noise. A box that contains an unusable pixel (``masks``) or leaves the image is not dark. With
    exact cameras and images without noise a voxel that emits is dark in no view: what remains
    holds the visual hull (Laurentini, "The visual hull concept for silhouette-based image
    understanding", IEEE PAMI 16, 1994), and that holds the emission. At an infinite margin nothing
    is carved. Some ``views`` may vote, all when None; pixels are returned for the others too.

    Inexact cameras contradict each other: one carves away what another sees, whose bright pixels
    then meet no active voxel. The margin grows until at most a thousandth of the bright light of
    any view is unexplained, and at most half a per cent of all light. Where no margin suffices,
    one more view must agree (``votes``); where two more do not suffice either, nothing is carved.

    Emission that an image cuts shows at its border. Boxes that leave an image are therefore tested
    by the nearest pixels of its border as well, and voxels that are dark by these are carved too,
    unless that leaves more light of any view unexplained: a second flame may lie out of one
    camera's view.

    ValueError: images or masks do not fit the cameras, or a setting is out of range.
    """
    _check(cameras, images, masks, margin, threshold, votes)
    lattices = Lattice.of_all(cameras, grid)
    brightness = Brightness.of(images, masks, _pixels_a_voxel(lattices), threshold, noise)
    voters = list(range(len(cameras)) if views is None else views)
    hull = Hulls(lattices, brightness, voters, grid.shape)
    if not hull.bright:
        reason = "no pixel is certainly bright: nothing is carved"
        return replace(_uncarved(brightness, hull.seen, grid, reason), dark=True)
    firsts = []
    for enough in votes_to_try(votes, len(voters)):
        margins = margins_to_try(margin, voters, images)
        found, first = smallest(hull, enough, margins, margin != "auto")
        firsts.append(first)
        if found is not None:
            break
    faint = min(one.carved_away for one in firsts)
    if found is None:
        agree = min(one.missed for one in firsts) <= UNEXPLAINED
        reason = (
            f"{faint:.1%} of the light is faint and would be carved away"
            if agree
            else "the views contradict each other"
        )
        return _uncarved(
            brightness, hull.seen, grid, f"{reason}: nothing is carved", faint if agree else 0.0
        )
    if math.isfinite(found.margin):
        further = replace(hull, beyond=True).at(found.margin, enough)
        most = max(found.carved_away, CARVED_AWAY)
        if further.missed <= found.missed and further.carved_away <= most:
            found = further
    return Carving(
        ActiveVoxels.from_mask(grid, found.active),
        tuple(a & b for a, b in zip(found.explained, brightness.usable, strict=True)),
        found.margin,
        brightness.threshold,
        brightness.smoothing,
        enough,
        found.missed,
        found.carved_away,
        faint,
        brightness.noise,
        _in_words(found, enough, len(voters), brightness),
    )


def _pixels_a_voxel(lattices: list[Lattice]) -> float:
    sizes = [lattice.pixels_a_voxel for lattice in lattices]
    sizes = [size for size in sizes if math.isfinite(size)]
    return float(np.median(sizes)) if sizes else 0.0


def _uncarved(
    brightness: Brightness,
    seen: list[NDArray[np.bool_]],
    grid: VoxelGrid,
    reason: str,
    faint_light: float = 0.0,
) -> Carving:
    return Carving(
        ActiveVoxels(grid),
        tuple(a & b for a, b in zip(seen, brightness.usable, strict=True)),
        0.0,
        brightness.threshold,
        brightness.smoothing,
        0,
        0.0,
        0.0,
        faint_light,
        brightness.noise,
        reason,
    )


def _in_words(found: Hull, votes: int, views: int, brightness: Brightness) -> str:
    blur = f" after a blur of {brightness.smoothing:.1f} pixels" if brightness.smoothing else ""
    return (
        f"{1 - found.active.mean():.1%} of the voxels are dark in {votes} or more of {views} "
        f"views: no pixel within {found.margin:g} of them is above {brightness.threshold:.3g}"
        f"{blur}; at most {found.missed:.2%} of the bright light of a view is unexplained, and "
        f"{found.carved_away:.2%} of all light is carved away"
    )


def _check(
    cameras: Sequence[CameraLike],
    images: Sequence[NDArray],
    masks: Sequence[NDArray] | None,
    margin: float | str,
    threshold: float | str,
    votes: int | str,
) -> None:
    """Check the arguments; one line names what is wrong."""
    check_sizes("images", images, cameras)
    if masks is not None:
        check_sizes("masks", masks, cameras)
    for name, value, endless in (("margin", margin, True), ("threshold", threshold, False)):
        is_good = isinstance(value, Real) and value >= 0 and (endless or math.isfinite(value))
        if value != "auto" and not is_good:
            raise ValueError(f"{name}: found {value!r}, expected auto or a number >= 0")
    if votes != "auto" and not (isinstance(votes, Integral) and 1 <= votes <= 255):
        raise ValueError(f"votes: found {votes!r}, expected auto or a whole number from 1 to 255")
