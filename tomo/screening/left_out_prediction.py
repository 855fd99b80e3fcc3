"""Views predicted from the other views, on pixels and voxels that may be coarser."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Self

import numpy as np
from numpy.typing import NDArray

from rigs import CameraLike, Rig
from rigs.geometry.rotation import matrix_of_vector
from tomo.grid import VoxelGrid
from tomo.measurement import NoiseModel
from tomo.operators import LinearSystem
from tomo.operators.system import VolumeNotSeenError
from tomo.scan.downsample import Coarser, coarsening
from tomo.screening.left_out_view import LeftOutView
from tomo.selfcal.left_out_views import EXPLAINING, larger_box, recorded
from tomo.solvers.initial_volume import log_back_projections
from tomo.solvers.quick_volume import quick_volume

SEGMENTS = 500_000
"""Segments of the coarse system, about: more take longer, fewer hide errors of a pixel."""

UNLIKE = 4.0
"""Times by which the mean square of an image may differ from the median of all before its errors
are divided by that instead: an image far too dark or too bright is no less wrong."""

FINER = 0.7
"""Width of the voxels that exact cameras are simulated on, over that of the voxels that predict:
on the same ones nothing is lost by voxels, on much finer ones it takes long."""


@dataclass(frozen=True, eq=False)
class CommonVolume:
    """A volume made from some of the views.

    Attributes
    ----------
    views : tuple of int
        The views that it was made from.
    unknowns : (unknowns,) float32
    images : list of (rows, columns) float32
        Its projection into every view.
    errors : (views,) float64
        Mean square of every view's residual beyond its noise, over `PredictedViews.light`.
    """

    views: tuple[int, ...]
    unknowns: NDArray[np.float32]
    images: Sequence[NDArray[np.float32]]
    errors: NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class PredictedViews:
    """All views, which volumes from some of them predict.

    Attributes
    ----------
    coarse : Coarser
    system : LinearSystem
    measured : (pixels,) float32
    masks : tuple of (rows, columns) bool
        True where a usable pixel sees the grid.
    noise : tuple of NoiseModel
        That of the recorded pixels, one a view.
    back_projections : (views, unknowns) float64
    """

    coarse: Coarser
    system: LinearSystem
    measured: NDArray[np.float32]
    masks: tuple[NDArray[np.bool_], ...]
    noise: Sequence[NoiseModel]
    back_projections: NDArray[np.float64]

    @classmethod
    def of(
        cls,
        rig: Rig,
        images: Sequence[NDArray[np.float32]],
        masks: Sequence[NDArray[np.bool_]],
        grid: VoxelGrid,
        noise: Sequence[NoiseModel],
    ) -> Self:
        """Trace the coarse system of all views.

        Raises
        ------
        tomo.operators.system.VolumeNotSeenError
            If no usable pixel sees the grid.
        """
        coarse = Coarser.of(rig, images, masks, grid, coarsening(rig, grid, SEGMENTS))
        system = LinearSystem.from_rig(coarse.rig, coarse.grid, masks=coarse.masks)
        measured = system.flatten(coarse.images)
        seeing = system.images(np.ones(len(measured), np.float32))
        back = log_back_projections(system.projector, measured)
        return cls(
            coarse, system, measured, tuple(image > 0 for image in seeing), tuple(noise), back
        )

    @property
    def factor(self) -> int:
        """Recorded pixels along the side of a coarse one."""
        return self.coarse.factor

    @cached_property
    def own_light(self) -> NDArray[np.float64]:
        """Mean square of every view's image, ``(views,)``."""
        return np.array(
            [
                np.mean(np.square(image[mask], dtype=np.float64)) if mask.any() else 0.0
                for image, mask in zip(self.coarse.images, self.masks, strict=True)
            ]
        )

    @cached_property
    def light(self) -> NDArray[np.float64]:
        """What squared errors are divided by: mean squares within `UNLIKE` of their median."""
        middle = float(np.median(self.own_light))
        return np.clip(self.own_light, middle / UNLIKE, UNLIKE * middle)

    @cached_property
    def noise_level(self) -> NDArray[np.float64]:
        """Mean square of every view's noise over that of its image, ``(views,)``."""
        found = np.zeros(len(self.masks))
        for view, (image, mask) in enumerate(zip(self.coarse.images, self.masks, strict=True)):
            if self.sees(view):
                found[view] = self._variance(view, image)[mask].mean() / self.light[view]
        return found

    def sees(self, view: int) -> bool:
        """Return whether usable pixels of a view see the grid, and there is light at all."""
        return bool(self.masks[view].any() and self.light[view] > 0)

    def volume(self, views: Sequence[int]) -> CommonVolume:
        """Return the volume made from some of the views."""
        unknowns = quick_volume(
            self.system.projector,
            self.measured,
            views,
            iterations=EXPLAINING,
            back_projections=self.back_projections,
        )
        images = self.system.images(self.system.projector @ unknowns)
        errors = np.array([self._error(v, image) for v, image in enumerate(images)])
        return CommonVolume(tuple(views), unknowns, images, errors)

    def of_exact_cameras(self, views: Sequence[int]) -> Self:
        """Return all views as exact cameras would record what some of them show.

        A volume of finer voxels in a larger box explains these views, and all cameras see it,
        with new noise. Details finer than a voxel and light from outside the grid are in it,
        errors of the other cameras are not.
        """
        coarse, box = self.coarse, larger_box(self.coarse.grid, FINER)
        system = LinearSystem.from_rig(coarse.rig, box, masks=coarse.masks)
        measured, projector = system.flatten(coarse.images), system.projector
        volume = quick_volume(projector, measured, views, iterations=EXPLAINING)
        seen = system.images((projector @ volume).astype(np.float32))
        variances = [self._variance(view, image) for view, image in enumerate(seen)]
        return self.with_images(recorded(seen, coarse.masks, variances))

    def with_images(self, images: Sequence[NDArray[np.float32]]) -> Self:
        """Return the views with other images ``(rows, columns)``, of the coarse size."""
        measured = self.system.flatten(images)
        back = log_back_projections(self.system.projector, measured)
        coarse = replace(self.coarse, images=tuple(images))
        return replace(self, coarse=coarse, measured=measured, back_projections=back)

    def left_out(self, view: int, volume: CommonVolume) -> LeftOutView:
        """Return a view with what a volume predicts of it and of the other cameras."""
        predicted = volume.images[view].astype(np.float64)
        mask, camera = self.masks[view], self.coarse.rig[view]
        others = {
            self.coarse.rig.names[other]: image.astype(np.float64)
            for other, image in enumerate(volume.images)
            if other != view and image.shape == predicted.shape
        }

        def reproject(pose: NDArray[np.float64]) -> NDArray[np.float64]:
            rig = Rig((moved(camera, pose, self.coarse.grid),))
            try:
                system = LinearSystem.from_rig(rig, self.coarse.grid, masks=[mask])
            except VolumeNotSeenError:
                return np.zeros(predicted.shape)
            return system.images(system.projector @ volume.unknowns)[0].astype(np.float64)

        return LeftOutView(
            self.coarse.images[view].astype(np.float64),
            predicted,
            mask,
            self._variance(view, predicted),
            others,
            reproject,
            self._pose_steps(camera),
        )

    def _variance(self, view: int, signal: NDArray[np.floating]) -> NDArray[np.float64]:
        return self.noise[view].variance(signal) / self.factor**2

    def _error(self, view: int, image: NDArray[np.float32]) -> float:
        if not self.sees(view):
            return np.nan
        mask, measured = self.masks[view], self.coarse.images[view].astype(np.float64)
        residual = float(np.mean((measured - image)[mask] ** 2))
        return (residual - float(self._variance(view, image)[mask].mean())) / self.light[view]

    def _pose_steps(self, camera: CameraLike) -> NDArray[np.float64]:
        """Return turns that move the grid's rim by a coarse pixel, and shifts of a pixel."""
        radius = float(np.linalg.norm(self.coarse.grid.extent)) / 2
        footprint = float(Rig((camera,)).footprint(self.coarse.grid.center)[0])
        turn = footprint / radius if np.isfinite(footprint) and radius > 0 else 0.02
        return np.array([turn, turn, turn, 1.0, 1.0])


def moved(camera: CameraLike, pose: NDArray[np.float64], grid: VoxelGrid) -> CameraLike:
    """Return a camera turned about the grid's centre, and with a shifted image.

    Parameters
    ----------
    camera : CameraLike
    pose : (5,) float64
        A rotation vector in radians, and shifts right and down in pixels.
    grid : VoxelGrid
    """
    turn = matrix_of_vector(np.asarray(pose[:3], np.float64))
    middle = np.asarray(grid.center, np.float64)
    return camera.transformed(turn, middle - turn @ middle).shifted(pose[3], pose[4])
