"""The network's input: six numbers a segment, from impacting voxels and segment points."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
from numpy.typing import ArrayLike

from tomo.grid import ActiveVoxels, VoxelGrid
from tomo.trace import Segments
from tomo.wernet.packing import Packing
from tomo.wernet.paper.product import packed_sum, weighted_sum
from tomo.wernet.ray_directions import ray_directions
from tomo.wernet.settings import INPUTS

Weigh = Callable[[torch.Tensor, torch.Tensor], torch.Tensor]
"""Weights of features and a mask: what `tomo.wernet.paper.WeightEncoder` does."""


@dataclass(frozen=True, eq=False)
class SampleBatch:
    """Some rays' segments, padded with zeros to the longest of these rays.

    The slow twin of `PackedBatch`, as the paper has it.

    Attributes
    ----------
    features : (rays, 6, width) float32
        See `RaySamples`; zero in the padding.
    voxel : (rays, width) int64
        Flat index of each voxel; the padding repeats a voxel of the same ray.
    mask : (rays, 1, width) float32
        One on a segment, zero on the padding.
    measured : (rays,) float32
        The pixel of each ray.
    """

    features: torch.Tensor
    voxel: torch.Tensor
    mask: torch.Tensor
    measured: torch.Tensor

    def __repr__(self) -> str:
        """Name the sizes: the tensors themselves are too long to print."""
        rays, _, width = self.features.shape
        return f"<SampleBatch: {rays} rays, padded to {width} segments>"

    def project(
        self, encoder: Weigh, voxels: torch.Tensor, normalise_gradient: bool = True
    ) -> torch.Tensor:
        """Return the rays' projections of ``voxels`` (voxels,) by the encoder's weights."""
        weights = encoder(self.features, self.mask)
        return weighted_sum(weights, voxels, self.voxel, normalise_gradient)


@dataclass(frozen=True, eq=False)
class PackedBatch:
    """Some rays' segments one behind another, nothing padded.

    Attributes
    ----------
    packing : Packing
        The places of the ``E`` segments.
    features : (E + rays + 1, 6) float32
        See `RaySamples`; zero in the empty rows.
    voxel : (E,) int64
        Voxel of each segment.
    measured : (rays,) float32
    """

    packing: Packing
    features: torch.Tensor
    voxel: torch.Tensor
    measured: torch.Tensor

    def __repr__(self) -> str:
        """Name the sizes: the tensors themselves are too long to print."""
        return f"<PackedBatch: {len(self.measured)} rays, {len(self.voxel)} segments>"

    def project(
        self, encoder: Weigh, voxels: torch.Tensor, normalise_gradient: bool = True
    ) -> torch.Tensor:
        """Return the rays' projections of ``voxels`` (voxels,) by the encoder's weights."""
        weights = encoder(self.features, self.packing.mask)[self.packing.row]
        return packed_sum(weights, voxels, self.voxel, self.packing, normalise_gradient)


@dataclass(frozen=True, eq=False)
class RaySamples:
    """The segments of every ray that crosses the grid, on one device, in packed form.

    Make one with `from_segments`; `packed` and `padded` cut batches out of it.

    Attributes
    ----------
    pixel : (rays,) int64
        Row of each ray in the segments' ``ptr``; pixels without a segment are left out.
    start, count : (rays,) int64
        Where each ray's segments begin, and how many there are.
    voxel : (S,) int32 or int64
        The unknown that each segment crosses.
    midpoint : (S, 3) float32
        Scaled midpoints.
    index : (voxels, 3) float32
        Scaled voxel indices of every unknown.
    measured : (rays,) float32
    direction : (rays, 3) float32 or None
        Unit vectors, with relative inputs.
    half : float
        Half the number of voxels along the grid's longest axis.

    Notes
    -----
    The paper feeds indices and coordinates and leaves their scale open. Here both ("absolute"
    inputs) are counted in voxels from the middle of the grid and divided by ``half``::

        index    -> (i - (n - 1) / 2) / (max(shape) / 2)
        midpoint -> m / spacing / (max(shape) / 2)

    so that all six rows lie in [-1, 1], a midpoint at a voxel's centre has the value of its
    index, and one step along any axis is the same number.

    "relative" inputs are twice the midpoint's place in its voxel, in voxels from the voxel's
    centre, which is a linear function of the absolute ones, and the direction of the ray.
    """

    pixel: torch.Tensor
    start: torch.Tensor
    count: torch.Tensor
    voxel: torch.Tensor
    midpoint: torch.Tensor
    index: torch.Tensor
    measured: torch.Tensor
    direction: torch.Tensor | None
    half: float

    def __len__(self) -> int:
        """Return the number of rays that have a segment."""
        return len(self.pixel)

    def __repr__(self) -> str:
        """Name the sizes: the tensors themselves are too long to print."""
        return f"<RaySamples: {len(self)} rays, {len(self.voxel)} segments>"

    @classmethod
    def from_segments(
        cls,
        segments: Segments,
        grid: VoxelGrid,
        measured: ArrayLike,
        device: torch.device | str = "cpu",
        *,
        active: ActiveVoxels | None = None,
        inputs: str = "absolute",
    ) -> RaySamples:
        """Return the samples of ``segments``, which must have midpoints.

        Parameters
        ----------
        segments : Segments
            Traced with ``midpoints=True``.
        grid : VoxelGrid
            The grid they were traced on.
        measured : (pixels,) float
            Projections in the order of the segments' pixels.
        device : torch.device or str
        active : ActiveVoxels, optional
            The voxels that the segments' numbers mean; all of the grid when None.
        inputs : {"absolute", "relative"}

        Raises
        ------
        ValueError
            If there are no midpoints or no segments, the sizes do not match, or the inputs are
            unknown.
        """
        if inputs not in INPUTS:
            raise ValueError(f"inputs: found {inputs!r}, expected one of {', '.join(INPUTS)}")
        if segments.midpoint is None:
            raise ValueError(
                "segments midpoint: found none, expected (S, 3): trace with midpoints=True"
            )
        if len(segments) == 0:
            raise ValueError("segments: found none, expected at least one ray through the grid")
        measured = np.asarray(measured, np.float32)
        if measured.shape != (segments.n_pixels,):
            raise ValueError(
                f"measured: found shape {measured.shape}, expected ({segments.n_pixels},)"
            )
        half = max(grid.shape) / 2
        midpoint = segments.midpoint / np.asarray(grid.spacing) / half  # from the grid's centre
        axes = [(np.arange(n) - (n - 1) / 2) / half for n in grid.shape]
        index = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)
        if active is not None and active.index is not None:
            index = index[active.index]
        counts = np.diff(segments.ptr)
        pixel = np.flatnonzero(counts)

        def move(array: np.ndarray) -> torch.Tensor:
            # A copy, so that nothing here aliases an array that belongs to somebody else.
            return torch.tensor(array, device=device)

        return cls(
            pixel=move(pixel),
            start=move(segments.ptr[pixel]),
            count=move(counts[pixel]),
            voxel=move(segments.voxel),
            midpoint=move(midpoint.astype(np.float32)),
            index=move(index.astype(np.float32)),
            measured=move(measured[pixel]),
            direction=move(ray_directions(segments)[pixel].astype(np.float32))
            if inputs == "relative"
            else None,
            half=half,
        )

    def to(self, device: torch.device | str) -> RaySamples:
        """Return the same samples on another device."""
        moved: dict[str, Any] = {
            name: value.to(device) if torch.is_tensor(value) else value
            for name, value in vars(self).items()
        }
        return RaySamples(**moved)

    def packed(self, rays: torch.Tensor) -> PackedBatch:
        """Return the rays numbered ``rays`` ``(B,)``, in ``0 .. len(self) - 1``."""
        rays = rays.to(self.start.device)
        packing = Packing.of(self.start[rays], self.count[rays])
        voxel = self.voxel[packing.segment].long()
        direction = None
        if self.direction is not None:
            direction = packing.per_segment(self.direction[rays])
        features = self._features(packing.segment, voxel, direction)
        return PackedBatch(packing, packing.to_rows(features), voxel, self.measured[rays])

    def _features(
        self, segment: torch.Tensor, voxel: torch.Tensor, direction: torch.Tensor | None
    ) -> torch.Tensor:
        index, midpoint = self.index[voxel], self.midpoint[segment]
        if direction is None:
            return torch.cat([index, midpoint], dim=-1)
        return torch.cat([(midpoint - index) * (2 * self.half), direction], dim=-1)

    def padded(self, rays: torch.Tensor, width: int | None = None) -> SampleBatch:
        """Return the rays numbered ``rays`` ``(B,)``, padded to the longest of them.

        Parameters
        ----------
        rays : (B,) int64
            Numbers in ``0 .. len(self) - 1``.
        width : int, optional
            Pad to this many segments instead; at least the longest ray's count.
        """
        rays = rays.to(self.start.device)
        count = self.count[rays][:, None]  # (B, 1)
        longest = int(count.max())
        if width is not None and width < longest:
            raise ValueError(f"width: found {width}, expected at least {longest}")
        columns = torch.arange(width or longest, device=count.device)
        inside = columns < count  # (B, width)
        segment = self.start[rays][:, None] + torch.minimum(columns, count - 1)
        voxel = self.voxel[segment].long()
        direction = None
        if self.direction is not None:
            direction = self.direction[rays][:, None].expand(-1, columns.numel(), -1)
        features = self._features(segment, voxel, direction)  # (B, width, 6)
        mask = inside.to(features.dtype)[:, None, :]
        return SampleBatch(
            features=features.transpose(1, 2) * mask,
            voxel=voxel,
            mask=mask,
            measured=self.measured[rays],
        )

    def crossed(self) -> torch.Tensor:
        """Return ``(voxels,)`` bool: the voxels that at least one ray crosses."""
        crossed = torch.zeros(len(self.index), dtype=torch.bool, device=self.voxel.device)
        crossed[self.voxel.long()] = True
        return crossed


def epoch_batches(
    n_rays: int, rays_per_step: int, generator: torch.Generator
) -> Iterator[torch.Tensor]:
    """Yield the rays of each batch of one epoch: every ray once, in a random order.

    The rays are dealt out anew every epoch; the last batch is what is left. The numbers come from
    ``generator``, on the CPU, so that the order does not depend on the device.
    """
    order = torch.randperm(n_rays, generator=generator)
    yield from order.split(rays_per_step)
