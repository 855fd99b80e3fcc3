"""Segments of some rays as the rows of one matrix, with an empty row around each ray."""

from __future__ import annotations

from dataclasses import dataclass

import torch


@dataclass(frozen=True, eq=False)
class Packing:
    """Which segments some rays have, and in which rows of a matrix they stand.

    Rays of different lengths stand one behind another without padding. The single empty row
    between two rays keeps a convolution of kernel three from mixing them.

    Attributes
    ----------
    segment : (E,) int64
        Numbers of the rays' segments, ray after ray.
    row : (E,) int64
        Row of each segment.
    count : (rays,) int64
        Number of segments of each ray.
    mask : (E + rays + 1, 1) float32
        One in a segment's row, zero in an empty one.
    """

    segment: torch.Tensor
    row: torch.Tensor
    count: torch.Tensor
    mask: torch.Tensor

    @classmethod
    def of(cls, start: torch.Tensor, count: torch.Tensor) -> Packing:
        """Return the packing of rays whose segments are ``start[r] : start[r] + count[r]``.

        Parameters
        ----------
        start, count : (rays,) int64
        """
        ends = torch.cumsum(count, 0)
        size = int(count.sum())
        number = torch.arange(size, device=count.device)  # (E,)
        rays = torch.arange(len(count), device=count.device)
        ray = rays.repeat_interleave(count, output_size=size)
        row = number + ray + 1
        mask = torch.zeros(len(number) + len(count) + 1, 1, device=count.device)
        mask[row] = 1
        return cls(number + (start - ends + count)[ray], row, count, mask)

    def __repr__(self) -> str:
        """Name the sizes: the tensors themselves are too long to print."""
        return f"<Packing: {len(self.count)} rays, {len(self.segment)} segments>"

    def to_rows(self, values: torch.Tensor) -> torch.Tensor:
        """Return ``values`` (E, C) in their rows, zeros in the empty ones."""
        rows = values.new_zeros(len(self.mask), values.shape[1])
        rows[self.row] = values
        return rows

    def per_segment(self, of_ray: torch.Tensor) -> torch.Tensor:
        """Return one value of each ray, ``(rays, ...)``, for each of its segments: (E, ...)."""
        return of_ray.repeat_interleave(self.count, dim=0, output_size=len(self.segment))

    def sum(self, values: torch.Tensor) -> torch.Tensor:
        """Return the sum over each ray's segments of ``values`` (E,): ``(rays,)``."""
        return torch.segment_reduce(values, "sum", lengths=self.count, unsafe=True)
