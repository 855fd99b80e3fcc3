"""What the default encoder sees of a segment: nothing of where in the world it lies."""

from __future__ import annotations

import itertools
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import torch
from numpy.typing import NDArray

from tomo.operators import Projector
from tomo.wernet.default import along_rays
from tomo.wernet.default.directions import ray_directions, squared_tangents
from tomo.wernet.packing import Packing

NAMES = (
    "place in the voxel, x",
    "place in the voxel, y",
    "place in the voxel, z",
    "direction, x",
    "direction, y",
    "direction, z",
    "depth in the grid",
    "chord",
    "place in the image, across",
    "place in the image, up",
    "place in the image, across squared",
    "place in the image, up squared",
    "emission in front",
)
TRENDS = ("depth in the grid", "emission in front", "off the axis, squared")
"""`tomo.wernet.default.variable_projection` looks along these first."""


@dataclass(frozen=True, eq=False)
class RayFeatures:
    """The crossings of a projector's rays, and the numbers that describe each to the encoder.

    An encoder that sees where a voxel lies can hide a smooth factor in the weights and its inverse
    in the voxels, with the loss still falling. So it is told the place *within* the voxel (from -1
    to 1), the ray's direction, how deep in the grid the segment lies as seen from the camera (from
    -1 to 1 over the grid's shortest edge), the chord in voxels, the pixel's place in its image
    (its angles from the view's mean direction, in units of ``widest``) and how much of what the
    camera sees lies in front.

    Attributes
    ----------
    start, count : (rays,) int64
        Where each ray's segments begin, and how many there are.
    view : (rays,) int64
    direction : (rays, 3) float32
    place : (rays, 2) float32
    off_axis : (rays,) float32
        The squared tangent of a ray's angle from its camera's line to the grid's centre, in units
        of ``widest``: lenses darken along it. Its axis must be alike in all views, which the
        view's mean direction is not.
    entry : (rays,) float32
        Where along its direction, measured from the grid's centre, a ray enters the grid.
    midpoint : (S, 3) float32
        From the grid's centre.
    length : (S,) float32
    voxel : (S,) integer
        The unknown that each segment crosses.
    centre : (unknowns, 3) float32
        Of the unknowns' voxels, from the grid's centre.
    spacing : (3,) float32
    shortest : float
        Edge of the grid.
    tells_views : bool
        Whether views have numbers of their own, and pixels their place in the image: with few
        views what is particular to each would be memorised instead of what is common to all.
    widest : (float, float)
        What counts as one in ``place`` and ``off_axis``: the largest of the rays trained with.
    """

    start: torch.Tensor
    count: torch.Tensor
    view: torch.Tensor
    direction: torch.Tensor
    place: torch.Tensor
    off_axis: torch.Tensor
    entry: torch.Tensor
    midpoint: torch.Tensor
    length: torch.Tensor
    voxel: torch.Tensor
    centre: torch.Tensor
    spacing: torch.Tensor
    shortest: float
    tells_views: bool
    widest: tuple[float, float]

    @classmethod
    def of(
        cls,
        projector: Projector,
        device: torch.device | str = "cpu",
        *,
        tells_views: bool = True,
        widest: tuple[float, float] | None = None,
    ) -> RayFeatures:
        """Return the features of a stored projector whose segments have midpoints.

        ``widest`` is that of the rays that weights were learned from; of these rays when None.

        Raises
        ------
        ValueError
            If the segments have no midpoints, or there is none.
        """
        segments, grid = projector.segments, projector.grid
        if segments.midpoint is None:
            raise ValueError(
                "segments midpoint: found none, expected (S, 3): trace with midpoints=True"
            )
        if len(segments) == 0:
            raise ValueError("segments: found none, expected at least one ray through the grid")
        # a view at a time: a pixel without a direction of its own takes that of a near one
        direction = np.concatenate(
            [ray_directions(projector.view(v).segments) for v in range(projector.n_views)]
        )
        place = _places(direction, projector.view_ptr)
        half = (np.asarray(grid.upper) - np.asarray(grid.lower)) / 2
        view = np.repeat(np.arange(projector.n_views), np.diff(projector.view_ptr))
        first = segments.midpoint[np.minimum(segments.ptr[:-1], len(segments) - 1)]
        crosses = np.diff(segments.ptr)[:, None] > 0  # no other has a point of its own
        off_axis = squared_tangents(first, np.where(crosses, direction, 0), projector.view_ptr)
        if widest is None:
            widest = float(np.abs(place).max()) or 1.0, float(off_axis.max()) or 1.0
        place, off_axis = place / widest[0], off_axis / widest[1]
        index = np.arange(grid.size) if projector.active.all else projector.active.index
        places = np.stack(np.unravel_index(index, grid.shape), axis=1)
        centre = (places - (np.asarray(grid.shape) - 1) / 2) * np.asarray(grid.spacing)

        def move(array: NDArray, kind: type = np.float32) -> torch.Tensor:
            return torch.from_numpy(np.ascontiguousarray(array, kind)).to(device)

        return cls(
            start=move(segments.ptr[:-1], np.int64),
            count=move(np.diff(segments.ptr), np.int64),
            view=move(view, np.int64),
            direction=move(direction),
            place=move(place if tells_views else np.zeros_like(place)),
            off_axis=move(off_axis if tells_views else np.zeros_like(off_axis)),
            entry=move(_entries(first.astype(np.float64), direction, half)),
            midpoint=move(segments.midpoint),
            length=move(segments.length),
            voxel=move(segments.voxel, segments.voxel.dtype.type),
            centre=move(centre),
            spacing=move(np.asarray(grid.spacing)),
            shortest=float(2 * half.min()),
            tells_views=tells_views,
            widest=widest,
        )

    def __repr__(self) -> str:
        """Name the sizes: the tensors themselves are too long to print."""
        return f"<RayFeatures: {len(self)} rays, {len(self.voxel)} segments>"

    def __len__(self) -> int:
        """Return the number of rays, those without a segment included."""
        return len(self.start)

    def packed(self, rays: torch.Tensor, front: torch.Tensor) -> tuple[Packing, torch.Tensor]:
        """Return the packing of some rays and the features of their segments: ``(E, 13)``.

        Parameters
        ----------
        rays : (B,) int64
            Each with at least one segment.
        front : (S,) float32
            What `emission_in_front` returned.
        """
        packing = Packing.of(self.start[rays], self.count[rays])
        entry = packing.entry
        midpoint = self.midpoint[entry]
        direction = packing.per_segment(self.direction[rays])
        place = packing.per_segment(self.place[rays])
        features = [
            2 * (midpoint - self.centre[self.voxel[entry].long()]) / self.spacing,
            direction,
            self.depth[entry][:, None],
            (self.length[entry] / self.spacing.log().mean().exp() - 0.5)[:, None],
            place,
            place.square(),
            front[entry][:, None],
        ]
        return packing, torch.cat(features, dim=1)

    @cached_property
    def depth(self) -> torch.Tensor:
        """How deep in the grid segments lie, from -1 to 1 over its shortest edge: ``(S,)``."""
        direction = torch.repeat_interleave(self.direction, self.count, dim=0)
        entry = torch.repeat_interleave(self.entry, self.count)
        return 2 * ((self.midpoint * direction).sum(dim=1) - entry) / self.shortest - 1

    def trends(self, front: torch.Tensor) -> tuple[NDArray[np.float32], ...]:
        """Return `TRENDS` of all segments, ``(S,)`` each."""
        off_axis = torch.repeat_interleave(self.off_axis, self.count)
        return tuple(each.cpu().numpy() for each in (self.depth, front, off_axis))

    def emission_in_front(self, volume: NDArray[np.float32], unit: float) -> torch.Tensor:
        """Return the emission between each segment's middle and the camera: ``(S,)`` float32.

        The sum of ``length x volume`` along the ray up to there, half of the segment's own
        included, over ``unit``.

        Parameters
        ----------
        volume : (unknowns,) float32
        unit : float
            A typical pixel; above zero.
        """
        crossings = (self.start, self.count, self.voxel, self.length)
        front = np.zeros(len(self.voxel), np.float32)
        along_rays.emission_in_front(
            *(tensor.cpu().numpy() for tensor in crossings),
            np.ascontiguousarray(volume, np.float32),
            float(unit),
            front,
        )
        return torch.from_numpy(front).to(self.length.device)


def _entries(
    point: NDArray[np.float64], direction: NDArray[np.float64], half: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return where along ``direction`` rays through ``point`` enter the box ``±half``."""
    with np.errstate(divide="ignore", invalid="ignore"):
        back = (point + np.where(direction > 0, half, -half)) / direction  # (rays, 3)
    back = np.where(direction == 0, np.inf, back).min(axis=1)
    back = np.where(np.isfinite(back), back, 0.0)
    return (point * direction).sum(axis=1) - back


def _places(direction: NDArray[np.float64], view_ptr: NDArray[np.int64]) -> NDArray[np.float64]:
    """Return the tangents of each ray's angles from its view's mean direction, ``(rays, 2)``."""
    place = np.zeros((len(direction), 2))
    for start, stop in itertools.pairwise(view_ptr):
        own = direction[start:stop]
        mean = own.sum(axis=0)
        if not np.linalg.norm(mean) > 0:
            continue
        mean /= np.linalg.norm(mean)
        up = np.eye(3)[1] if abs(mean[1]) < 0.9 else np.eye(3)[2]
        across = np.cross(mean, up)
        across /= np.linalg.norm(across)
        axes = np.stack([across, np.cross(mean, across)], axis=1)  # (3, 2)
        place[start:stop] = (own @ axes) / np.maximum(own @ mean, 0.1)[:, None]
    return place
