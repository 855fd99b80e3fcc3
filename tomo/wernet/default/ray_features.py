"""The features of a segment that the default encoder sees, none of them its place in the world."""

from __future__ import annotations

import itertools
from dataclasses import dataclass
from functools import cached_property

import numba
import numpy as np
import torch
from numpy.typing import NDArray

from tomo._compute.jit import compiled
from tomo.operators import Projector
from tomo.wernet.packing import Packing
from tomo.wernet.ray_directions import ray_directions, squared_tangents

FEATURES = (
    "position in the voxel, x",
    "position in the voxel, y",
    "position in the voxel, z",
    "direction, x",
    "direction, y",
    "direction, z",
    "depth in the grid",
    "segment length",
    "position in the image, across",
    "position in the image, up",
    "position in the image, across squared",
    "position in the image, up squared",
    "upstream emission",
)
TERMS = ("depth in the grid", "upstream emission", "off the axis, squared")
"""Global terms of the exponent: even absorption, self-absorption and vignetting."""


@dataclass(frozen=True, eq=False)
class RayFeatures:
    """The segments of a projector's rays, and the features that describe each to the encoder.

    An encoder that sees where a voxel lies can hide a smooth factor in the weights and its inverse
    in the voxels while the loss still falls. The features are therefore relative:

    - position *within* the voxel, from -1 to 1,
    - direction of the ray,
    - depth in the grid as seen from the camera, from -1 to 1 over the grid's shortest edge,
    - segment length in voxels,
    - position in the image: the tangents of the angles from the view's mean direction, in units
      of ``image_scale``,
    - upstream emission: the light between the segment and the camera.

    Attributes
    ----------
    start, count : (rays,) int64
        First segment and number of segments of each ray.
    view : (rays,) int64
    direction : (rays, 3) float32
    image_position : (rays, 2) float32
    off_axis : (rays,) float32
        Squared tangent of a ray's angle from its camera's line to the grid's centre, in units of
        ``image_scale``. Vignetting follows it. The axis is alike in all views; the view's mean
        direction is not.
    entry_distance : (rays,) float32
        Where a ray enters the grid, along its direction from the grid's centre.
    midpoint : (S, 3) float32
        From the grid's centre.
    length : (S,) float32
    voxel : (S,) integer
        The unknown that each segment crosses.
    centre : (unknowns, 3) float32
        Centres of the unknowns' voxels, from the grid's centre.
    spacing : (3,) float32
    shortest_edge : float
        The grid's shortest edge.
    per_view : bool
        Whether the encoder sees where a pixel lies in the image. With few views it would memorise
        each view instead of finding what all have in common.
    image_scale : (float, float)
        Units of ``image_position`` and ``off_axis``: their largest values among the training rays.
    """

    start: torch.Tensor
    count: torch.Tensor
    view: torch.Tensor
    direction: torch.Tensor
    image_position: torch.Tensor
    off_axis: torch.Tensor
    entry_distance: torch.Tensor
    midpoint: torch.Tensor
    length: torch.Tensor
    voxel: torch.Tensor
    centre: torch.Tensor
    spacing: torch.Tensor
    shortest_edge: float
    per_view: bool
    image_scale: tuple[float, float]

    @classmethod
    def of(
        cls,
        projector: Projector,
        device: torch.device | str = "cpu",
        *,
        per_view: bool = True,
        image_scale: tuple[float, float] | None = None,
    ) -> RayFeatures:
        """Return the features of a stored projector whose segments have midpoints.

        Parameters
        ----------
        projector : Projector
        device : torch.device or str
        per_view : bool
        image_scale : (float, float), optional
            That of the rays that weights were learned from; that of these rays when None.

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
        # View by view: a pixel without a direction of its own takes that of a neighbour.
        direction = np.concatenate(
            [ray_directions(projector.view(v).segments) for v in range(projector.n_views)]
        )
        position = _image_positions(direction, projector.view_ptr)
        half = (np.asarray(grid.upper) - np.asarray(grid.lower)) / 2
        view = np.repeat(np.arange(projector.n_views), np.diff(projector.view_ptr))
        first = segments.midpoint[np.minimum(segments.ptr[:-1], len(segments) - 1)]
        nonempty = np.diff(segments.ptr)[:, None] > 0  # an empty ray has no point of its own
        off_axis = squared_tangents(first, np.where(nonempty, direction, 0), projector.view_ptr)
        if image_scale is None:
            image_scale = float(np.abs(position).max()) or 1.0, float(off_axis.max()) or 1.0
        position, off_axis = position / image_scale[0], off_axis / image_scale[1]
        index = np.arange(grid.size) if projector.active.all else projector.active.index
        indices = np.stack(np.unravel_index(index, grid.shape), axis=1)  # (unknowns, 3)
        centre = (indices - (np.asarray(grid.shape) - 1) / 2) * np.asarray(grid.spacing)

        def move(array: NDArray, kind: type = np.float32) -> torch.Tensor:
            return torch.from_numpy(np.ascontiguousarray(array, kind)).to(device)

        return cls(
            start=move(segments.ptr[:-1], np.int64),
            count=move(np.diff(segments.ptr), np.int64),
            view=move(view, np.int64),
            direction=move(direction),
            image_position=move(position if per_view else np.zeros_like(position)),
            off_axis=move(off_axis),
            entry_distance=move(_entry_distances(first.astype(np.float64), direction, half)),
            midpoint=move(segments.midpoint),
            length=move(segments.length),
            voxel=move(segments.voxel, segments.voxel.dtype.type),
            centre=move(centre),
            spacing=move(np.asarray(grid.spacing)),
            shortest_edge=float(2 * half.min()),
            per_view=per_view,
            image_scale=image_scale,
        )

    def __repr__(self) -> str:
        """Name the sizes: the tensors themselves are too long to print."""
        return f"<RayFeatures: {len(self)} rays, {len(self.voxel)} segments>"

    def __len__(self) -> int:
        """Return the number of rays, those without a segment included."""
        return len(self.start)

    def packed(self, rays: torch.Tensor, upstream: torch.Tensor) -> tuple[Packing, torch.Tensor]:
        """Return the packing of some rays and the features of their segments: ``(E, 13)``.

        Parameters
        ----------
        rays : (B,) int64
            Each with at least one segment.
        upstream : (S,) float32
            Upstream emission of all segments, see `upstream_emission`.
        """
        packing = Packing.of(self.start[rays], self.count[rays])
        segment = packing.segment
        midpoint = self.midpoint[segment]
        direction = packing.per_segment(self.direction[rays])
        position = packing.per_segment(self.image_position[rays])
        features = [
            2 * (midpoint - self.centre[self.voxel[segment].long()]) / self.spacing,
            direction,
            self.depth[segment][:, None],
            (self.length[segment] / self.spacing.log().mean().exp() - 0.5)[:, None],
            position,
            position.square(),
            upstream[segment][:, None],
        ]
        return packing, torch.cat(features, dim=1)

    @cached_property
    def depth(self) -> torch.Tensor:
        """Depth of segments in the grid, from -1 to 1 over its shortest edge: ``(S,)``."""
        direction = torch.repeat_interleave(self.direction, self.count, dim=0)
        entry = torch.repeat_interleave(self.entry_distance, self.count)
        return 2 * ((self.midpoint * direction).sum(dim=1) - entry) / self.shortest_edge - 1

    def terms(self, upstream: torch.Tensor) -> tuple[NDArray[np.float32], ...]:
        """Return the values of `TERMS` for all segments, ``(S,)`` each."""
        off_axis = torch.repeat_interleave(self.off_axis, self.count)
        return tuple(each.cpu().numpy() for each in (self.depth, upstream, off_axis))

    def upstream_emission(self, volume: NDArray[np.float32], unit: float) -> torch.Tensor:
        """Return the emission between the camera and each segment's middle: ``(S,)`` float32.

        It is the sum of ``length x volume`` along the ray up to there, half of the segment's own
        included, over ``unit``.

        Parameters
        ----------
        volume : (unknowns,) float32
        unit : float
            A typical pixel; above zero.
        """
        segments = (self.start, self.count, self.voxel, self.length)
        upstream = np.zeros(len(self.voxel), np.float32)
        _sum_upstream(
            *(tensor.cpu().numpy() for tensor in segments),
            np.ascontiguousarray(volume, np.float32),
            float(unit),
            upstream,
        )
        return torch.from_numpy(upstream).to(self.length.device)


def _entry_distances(
    point: NDArray[np.float64], direction: NDArray[np.float64], half: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return where along ``direction`` rays through ``point`` enter the box ``±half``: (rays,)."""
    with np.errstate(divide="ignore", invalid="ignore"):
        back = (point + np.where(direction > 0, half, -half)) / direction  # (rays, 3)
    back = np.where(direction == 0, np.inf, back).min(axis=1)
    back = np.where(np.isfinite(back), back, 0.0)
    return (point * direction).sum(axis=1) - back


def _image_positions(
    direction: NDArray[np.float64], view_ptr: NDArray[np.int64]
) -> NDArray[np.float64]:
    """Return the tangents of each ray's angles from its view's mean direction, ``(rays, 2)``."""
    position = np.zeros((len(direction), 2))
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
        position[start:stop] = (own @ axes) / np.maximum(own @ mean, 0.1)[:, None]
    return position


@compiled(parallel=True)
def _sum_upstream(start, count, voxel, length, volume, unit, upstream) -> None:
    """Write the emission between the camera and each segment's middle to ``upstream`` (S,)."""
    for ray in numba.prange(len(start)):
        before = 0.0
        for s in range(start[ray], start[ray] + count[ray]):
            own = np.float64(length[s]) * np.float64(volume[voxel[s]])
            upstream[s] = (before + own / 2) / unit
            before += own
