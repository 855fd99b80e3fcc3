"""The pixels that explanations of the images are compared on, and the quick solve behind it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from tomo.grid import ActiveVoxels, VoxelGrid
from tomo.measurement import NoiseModel
from tomo.operators import STORED, Absorption, LinearSystem
from tomo.operators.operator import ProjectionOperator
from tomo.pipeline.basis import linear_where_possible
from tomo.pipeline.options import Options
from tomo.pipeline.trace import through_gas
from tomo.scan.downsample import Coarser
from tomo.screening.causes import volume_of
from tomo.screening.hypotheses import TRANSPARENT, Evidence
from tomo.screening.left_out_blocks import Blocks
from tomo.selection.choose import FIRST, STRENGTHS
from tomo.selection.smooth_solve import smooth_start, solve_smoothly

ITERATIONS = 10
"""Iterations of least squares of the quick solve. Fewer leave differences of convergence that look
like causes, more predict pixels left out no better."""

SEGMENTS = 1_500_000
"""Segments above which pixels and voxels are enlarged. More take longer, fewer hide what thin
flames tell."""


@dataclass(frozen=True, eq=False)
class Sample:
    """Equations small enough to try explanations on, and the evidence of their pixels.

    Attributes
    ----------
    system : LinearSystem
        In the linear basis where that is possible.
    evidence : Evidence
    """

    system: LinearSystem
    evidence: Evidence

    def emission(self, volume: NDArray[np.float32], grid: VoxelGrid) -> NDArray[np.float32]:
        """Return the mean emission in the voxels of a grid of the same box, from the unknowns."""
        from scipy.ndimage import zoom

        coarse = volume_of(self.system, volume)
        if coarse.shape == grid.shape:
            return coarse
        ratio = np.divide(grid.shape, coarse.shape)
        return zoom(coarse, ratio, order=1, mode="nearest", grid_mode=True)


def sample_of(
    system: LinearSystem,
    measured: NDArray[np.float32],
    noise: Sequence[NoiseModel],
    options: Options,
    absorption: Absorption = TRANSPARENT,
) -> Sample:
    """Return the equations that explanations are tried on.

    Parameters
    ----------
    system : LinearSystem
        Large ones are taken to larger pixels and voxels, unless a lens blurs the images.
    measured : (pixels,) float32
    noise : sequence of NoiseModel
        Of each view.
    options : Options
        The tracer and the rays a pixel are used.
    absorption : Absorption
        That of the system, not by emission.
    """
    variance = variance_of(system, measured, noise)
    factor = round((system.projector.n_segments / SEGMENTS) ** (1 / 3))
    if factor > 1 and system.form == STORED and not options.blur:
        system, measured, variance = _coarser(system, measured, variance, factor, options)
        system = through_gas(system, absorption, None, options)
    else:
        system, _ = linear_where_possible(system, options.supersample)
    return Sample(system, Evidence(measured, Blocks.of(system), variance, quick_solve))


def variance_of(
    system: LinearSystem, measured: NDArray, noise: Sequence[NoiseModel]
) -> NDArray[np.float64]:
    """Return the variance of the noise in every pixel that takes part, ``(pixels,)``.

    Parameters
    ----------
    system : LinearSystem
    measured : (pixels,)
    noise : sequence of NoiseModel
        Of each view.
    """
    spans = pairwise(system.projector.view_ptr)
    return np.concatenate(
        [
            model.variance(measured[start:stop])
            for model, (start, stop) in zip(noise, spans, strict=True)
        ]
    )


def quick_solve(
    projector: ProjectionOperator,
    measured: NDArray[np.float32],
    start: NDArray[np.float32] | None = None,
) -> NDArray[np.float32]:
    """Return a smooth volume that reproduces the pixels, ``(unknowns,)``, from ``start`` or none.

    It is the default's solve with the strength that is tried first: ten times less follows the
    noise, ten times more blurs thin flames, on scenes from clean to a tenth of noise.
    """
    start = smooth_start(projector, measured) if start is None else start
    how = {"width": 0.0, "strength": STRENGTHS[FIRST], "iterations": ITERATIONS, "start": start}
    return projector.active.compress(solve_smoothly(projector, measured, **how).volume)


def _coarser(
    system: LinearSystem,
    measured: NDArray[np.float32],
    variance: NDArray[np.float64],
    factor: int,
    options: Options,
) -> tuple[LinearSystem, NDArray[np.float32], NDArray[np.float64]]:
    """Return equations, measured pixels and their variance, of larger pixels and voxels."""
    masks = [image > 0 for image in system.images(np.ones_like(measured))]
    pixels, squares = (
        Coarser.of(system.rig, system.images(flat), masks, system.projector.grid, factor)
        for flat in (measured, variance.astype(np.float32))
    )
    found, _ = linear_where_possible(
        LinearSystem.from_rig(
            pixels.rig,
            pixels.grid,
            masks=pixels.masks,
            active=_active(system.projector.active, pixels.grid),
            skip=False,
            tracer=options.tracer,
            **options.rays,
            form=STORED,
        ),
        options.supersample,
    )
    spread = found.flatten(squares.images).astype(np.float64) / factor**2
    return found, found.flatten(pixels.images), spread


def _active(active: ActiveVoxels, grid: VoxelGrid) -> ActiveVoxels:
    """Return the voxels of a coarser grid of the same box that hold an active one's centre."""
    mask = np.zeros(grid.shape, bool)
    fine = np.nonzero(active.mask)
    shapes = zip(fine, grid.shape, active.grid.shape, strict=True)
    mask[tuple((2 * own + 1) * coarse // (2 * many) for own, coarse, many in shapes)] = True
    return ActiveVoxels.from_mask(grid, mask)
