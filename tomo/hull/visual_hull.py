"""The visual hull of an object, opaque or luminous, from its silhouettes."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from tomo.grid import VoxelGrid
from tomo.hull.dark_votes import dark_votes, touched
from tomo.hull.projection_lattice import Lattice

if TYPE_CHECKING:
    from rigs import CameraLike


@dataclass(frozen=True, eq=False)
class VisualHull:
    """The voxels that no silhouette excludes, and the pixels that see them.

    Attributes
    ----------
    grid : VoxelGrid
    inside : (nx, ny, nz) bool
    images : tuple of (height, width) bool
        For each camera the pixels that a voxel of the hull, as a box, touches.
    """

    grid: VoxelGrid
    inside: NDArray[np.bool_]
    images: tuple[NDArray[np.bool_], ...]

    def __repr__(self) -> str:
        """Name the sizes."""
        return f"<VisualHull: {np.count_nonzero(self.inside)} voxels of {self.grid}>"

    def overlaps(self, silhouettes: Sequence[NDArray[np.bool_]]) -> NDArray[np.float64]:
        """Return intersection over union of the hull's images with silhouettes, ``(views,)``.

        NaN where both are empty.
        """
        pairs = list(zip(self.images, silhouettes, strict=True))
        common = np.array([np.count_nonzero(seen & own) for seen, own in pairs], np.float64)
        either = np.array([np.count_nonzero(seen | own) for seen, own in pairs], np.float64)
        return np.divide(common, either, out=np.full(len(pairs), np.nan), where=either > 0)


def visual_hull(
    cameras: Sequence[CameraLike], silhouettes: Sequence[NDArray[np.bool_]], grid: VoxelGrid
) -> VisualHull:
    """Carve away every voxel whose projected box lies wholly outside a silhouette.

    The remaining voxels hold every object with these silhouettes (Laurentini, "The visual hull
    concept for silhouette-based image understanding", IEEE PAMI 16, 1994): a view excludes a voxel
    when its box touches no pixel of the silhouette. A box that leaves the image is not excluded.
    `tomo.hull.carve` does the same for noisy emission.

    Parameters
    ----------
    cameras : sequence of CameraLike
    silhouettes : sequence of (height, width) bool
        One a camera: True where it sees the object.
    grid : VoxelGrid

    Raises
    ------
    ValueError
        If a silhouette does not fit its camera, or there is not one a camera.
    """
    if len(silhouettes) != len(cameras):
        raise ValueError(
            f"silhouettes: found {len(silhouettes)}, expected one for each of {len(cameras)} "
            "cameras"
        )
    for camera, own in zip(cameras, silhouettes, strict=True):
        width, height = camera.image_size
        if np.shape(own) != (height, width) or np.asarray(own).dtype != np.bool_:
            raise ValueError(
                f"silhouettes: camera {camera.name}: found {np.asarray(own).dtype} of shape "
                f"{np.shape(own)}, expected bool of {(height, width)}"
            )
    lattices = Lattice.of_all(cameras, grid)
    inside = dark_votes(silhouettes, lattices, grid.shape, margin=0.0, enough=1) == 0
    shapes = [own.shape for own in silhouettes]
    return VisualHull(grid, inside, tuple(touched(inside, lattices, shapes)))
