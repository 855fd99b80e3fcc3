"""The segments of an operator's rays as tensors, and some of these rays packed for a network."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Any, cast

import numpy as np
import torch
from numpy.typing import ArrayLike, NDArray

from tomo.operators.operator import ProjectionOperator
from tomo.operators.stored import Projector
from tomo.wernet.features import RayFeatures

Device = torch.device | str


@dataclass(frozen=True, eq=False)
class RayBatch:
    """Some rays, their segments one behind another in the rows of a matrix.

    Rays of different lengths need no padding. The single empty row between two rays keeps a
    convolution of kernel three from mixing them.

    Attributes
    ----------
    count : (B,) int64
        Number of segments of each ray.
    row : (E,) int64
        Row of each segment.
    mask : (N, 1) float32
        One in a segment's row, zero in an empty one; ``N`` is ``E + B + 1``.
    features : (N, F) float32
        What the encoder sees of each segment; zero in the empty rows.
    voxel : (E,) int64
        The unknown that each segment crosses.
    length : (E,) float32
    number, view : (B,) int64
        The number of each ray among all, and its view.
    squared_radius : (B,) float32, optional
        Of each ray's pixel, one in the corners of its image.
    """

    count: torch.Tensor
    row: torch.Tensor
    mask: torch.Tensor
    features: torch.Tensor
    voxel: torch.Tensor
    length: torch.Tensor
    number: torch.Tensor
    view: torch.Tensor
    squared_radius: torch.Tensor | None = None

    def __len__(self) -> int:
        """Return the number of rays."""
        return len(self.count)

    def __repr__(self) -> str:
        """Name the sizes: the tensors themselves are too long to print."""
        return f"<RayBatch: {len(self)} rays, {len(self.voxel)} segments>"

    def sum(self, values: torch.Tensor) -> torch.Tensor:
        """Return the sum over each ray's segments of ``values`` (E,): ``(B,)``."""
        return torch.segment_reduce(values, "sum", lengths=self.count, unsafe=True, initial=0)

    def per_segment(self, of_ray: torch.Tensor) -> torch.Tensor:
        """Return one value of each ray, ``(B, ...)``, for each of its segments: (E, ...)."""
        return of_ray.repeat_interleave(self.count, dim=0, output_size=len(self.voxel))

    def before(self, values: torch.Tensor) -> torch.Tensor:
        """Return the sum of ``values`` (E,) along each ray up to the middle of each segment."""
        return _up_to_middles(values.double(), self.count).to(values.dtype)

    def split(self, rays: Sequence[int]) -> Iterator[RayBatch]:
        """Yield the batch in parts of so many rays each, without copies."""
        starts = [0, *np.cumsum(rays).tolist()]
        ends = [0, *self.count.cumsum(0).cpu().tolist()]
        for first, last in pairwise(starts):
            segments = slice(ends[first], ends[last])
            rows = slice(segments.start + first, segments.stop + last + 1)
            radius = self.squared_radius
            yield RayBatch(
                self.count[first:last],
                self.row[segments] - rows.start,
                self.mask[rows],
                self.features[rows],
                self.voxel[segments],
                self.length[segments],
                self.number[first:last],
                self.view[first:last],
                None if radius is None else radius[first:last],
            )


@dataclass(frozen=True, eq=False)
class Rays:
    """The rays of a stored operator on one device, with what an encoder sees of them.

    Make them with `of`; `take` packs some of them.

    Attributes
    ----------
    start, count : (rays,) int64
        First segment and number of segments of each ray; a pixel whose ray misses has none.
    voxel : (S,) int32 or int64
        The unknown that each segment crosses.
    length : (S,) float32
    view : (rays,) int64
    unknowns : int
        Number of voxels that are solved for.
    squared_radius : (rays,) float32, optional
    """

    start: torch.Tensor
    count: torch.Tensor
    voxel: torch.Tensor
    length: torch.Tensor
    view: torch.Tensor
    features: RayFeatures
    unknowns: int
    squared_radius: torch.Tensor | None = None

    @classmethod
    def of(
        cls,
        projector: ProjectionOperator,
        inputs: str = "relative",
        *,
        device: Device = "cpu",
        image_scale: float | None = None,
        squared_radius: ArrayLike | None = None,
    ) -> Rays:
        """Return the rays of a stored operator, its segments with midpoints.

        Parameters
        ----------
        projector : ProjectionOperator
            Its lens blur, if it has one, is left out.
        inputs : str
            What the encoder sees, see `tomo.wernet.features.INPUTS`.
        image_scale : float, optional
            See `RayFeatures`; that of these rays when None.
        squared_radius : (pixels,) float, optional
            Squared distance of each pixel from the middle of its image, one in the corners. A
            fall-off needs it; `tomo.model.squared_radius` gives it for an image, and
            `LinearSystem.flatten` for the pixels of an operator.

        Raises
        ------
        ValueError
            If the segments have no midpoints, there is none, or a size does not match.
        """
        rays = cast(Projector, projector.without_blur)
        segments = rays.segments
        if segments.midpoint is None:
            raise ValueError(
                "segments midpoint: found none, expected (S, 3): trace with midpoints=True"
            )
        if len(segments) == 0:
            raise ValueError("segments: found none, expected at least one ray through the grid")
        radius = squared_radius
        if radius is not None:
            radius = np.asarray(radius, np.float32)
            if radius.shape != (segments.n_pixels,):
                raise ValueError(
                    f"squared_radius: found shape {radius.shape}, expected ({segments.n_pixels},)"
                )
        view = np.repeat(np.arange(rays.n_views), np.diff(rays.view_ptr))

        def move(array: NDArray) -> torch.Tensor:
            return torch.tensor(array, device=device)  # a copy: nothing aliases another's array

        return cls(
            start=move(segments.ptr[:-1].astype(np.int64)),
            count=move(np.diff(segments.ptr).astype(np.int64)),
            voxel=move(segments.voxel),
            length=move(segments.length.astype(np.float32)),
            view=move(view.astype(np.int64)),
            features=RayFeatures.of(rays, inputs, device=device, image_scale=image_scale),
            unknowns=rays.shape[1],
            squared_radius=None if radius is None else move(radius),
        )

    def __len__(self) -> int:
        """Return the number of rays."""
        return len(self.start)

    def __repr__(self) -> str:
        """Name the sizes: the tensors themselves are too long to print."""
        return f"<Rays: {len(self)} rays, {len(self.voxel)} segments, {self.features!r}>"

    @property
    def crossing(self) -> torch.Tensor:
        """The numbers of the rays that cross the grid, ``(crossing,)`` int64, on the CPU."""
        return self.count.cpu().nonzero()[:, 0]

    def crossed(self) -> torch.Tensor:
        """Return ``(unknowns,)`` bool: the voxels that at least one ray crosses."""
        crossed = torch.zeros(self.unknowns, dtype=torch.bool, device=self.voxel.device)
        crossed[self.voxel.long()] = True
        return crossed

    def with_upstream(self, volume: NDArray[np.float32], unit: float) -> Rays:
        """Return the rays with the emission that each segment has before it.

        The sum of ``length x volume`` along the ray from the camera up to the segment's middle,
        over ``unit``, a typical pixel, above zero.
        """
        light = self.length.cpu() * torch.from_numpy(volume[self.voxel.cpu().numpy()]).double()
        upstream = _up_to_middles(light, self.count.cpu()) / unit
        return replace(self, features=self.features.with_column(-1, upstream))

    def take(self, numbers: torch.Tensor) -> RayBatch:
        """Return some rays, packed, by ``numbers`` (B,) from 0.

        From ``len(self)`` on they are the same rays in the next frame: their voxels are those of a
        second volume, behind the first, and so on.
        """
        numbers = numbers.to(self.start.device)
        frame, ray = numbers // len(self), numbers % len(self)
        count = self.count[ray]
        ends = count.cumsum(0)
        size = int(ends[-1]) if len(ends) else 0
        order = torch.arange(len(ray), device=ray.device)
        of_segment = order.repeat_interleave(count, output_size=size)  # (E,)
        place = torch.arange(size, device=ray.device)
        segment = place + (self.start[ray] - ends + count).index_select(0, of_segment)
        row = place + of_segment + 1
        mask = self.length.new_zeros(size + len(ray) + 1, 1)
        mask[row] = 1
        described = self.features.of_segments(segment, ray.index_select(0, of_segment))
        features = described.new_zeros(len(mask), described.shape[1]).index_copy_(
            0, row, described
        )
        voxel = self.voxel.index_select(0, segment).long()
        voxel += (frame * self.unknowns).index_select(0, of_segment)
        length, radius = self.length.index_select(0, segment), self.squared_radius
        return RayBatch(
            count, row, mask, features, voxel, length, numbers, self.view[ray],
            None if radius is None else radius[ray],
        )  # fmt: skip

    def to(self, device: Device) -> Rays:
        """Return the same rays on another device."""
        moved: dict[str, Any] = {
            name: value if isinstance(value, int | None) else value.to(device)
            for name, value in vars(self).items()
        }
        return Rays(**moved)


def _up_to_middles(values: torch.Tensor, count: torch.Tensor) -> torch.Tensor:
    """Return the sum of ``values`` (E,) float64 along each ray up to each segment's middle.

    ``count`` (rays,) are the numbers of segments of rays that stand one behind another.
    """
    ends = values.cumsum(0)
    first = torch.cat([ends.new_zeros(1), ends])[count.cumsum(0) - count]
    return ends - values / 2 - first.repeat_interleave(count, output_size=len(values))
