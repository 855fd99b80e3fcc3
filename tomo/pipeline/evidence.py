"""The pixels that explanations of the images are compared on, and the quick solve behind it."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from tomo._compute.grouping import golden_ratio_sequence
from tomo.measurement import NoiseModel
from tomo.operators import STORED, LinearSystem
from tomo.operators.operator import ProjectionOperator
from tomo.pipeline.options import Options
from tomo.screening.hypotheses import Evidence
from tomo.screening.left_out_blocks import Blocks, blocks_of
from tomo.solvers import curvature, mlem
from tomo.solvers.initial_volume import mlos_start

STRENGTH = 1e-3
"""Prior strength of the quick solve. Ten times less follows the noise, ten times more blurs thin
flames, on scenes from clean to a tenth of noise."""

FIRST, ITERATIONS = 10, 10
"""Iterations of MLEM from scratch, and of least squares from there or from a volume nearby. Fewer
leave differences of convergence that look like causes, more predict pixels left out no better."""

SEGMENTS = 1_500_000
"""Segments that large systems are thinned to. More take longer, fewer make the volume coarse."""


def evidence_of(
    system: LinearSystem,
    measured: NDArray[np.float32],
    noise: Sequence[NoiseModel],
    options: Options,
) -> tuple[Evidence, LinearSystem]:
    """Return the evidence of the images, and the equations of its pixels.

    Parameters
    ----------
    system : LinearSystem
        In the voxel basis. Large ones are thinned, unless a lens blurs the images; others are
        taken to the linear basis.
    measured : (pixels,) float32
    noise : sequence of NoiseModel
        Of each view.
    options : Options
        The tracer and the rays a pixel are used.
    """
    kept = slice(None)
    if system.projector.n_segments > SEGMENTS and system.projector.rows_are_single_rays:
        block = blocks_of(system)
        order = golden_ratio_sequence(int(block.max()) + 1)
        kept = np.flatnonzero(order[block] < SEGMENTS / system.projector.n_segments)
        system = _thinned(system, kept, options)
    else:
        system = smooth(system, options)
    measured, pointers = measured[kept], system.projector.view_ptr
    variance = [
        model.variance(measured[start:stop])
        for model, start, stop in zip(noise, pointers[:-1], pointers[1:], strict=True)
    ]
    return Evidence(measured, Blocks.of(system), np.concatenate(variance), quick_solve), system


def quick_solve(
    projector: ProjectionOperator,
    measured: NDArray[np.float32],
    start: NDArray[np.float32] | None = None,
) -> NDArray[np.float32]:
    """Return a smooth volume that reproduces the pixels, ``(unknowns,)``, from ``start`` or none.

    A few iterations of MLEM find where it is bright, some of `tomo.solvers.curvature` the rest.
    """
    active = projector.active
    if start is None:
        first = mlos_start(projector, measured)
        start = active.compress(mlem(projector, measured, iterations=FIRST, start=first).volume)
    how = {"strength": STRENGTH, "iterations": ITERATIONS, "start": start}
    return active.compress(curvature(projector, measured, **how).volume)


def smooth(system: LinearSystem, options: Options) -> LinearSystem:
    """Return a system in the linear basis, where there is one: voxels' edges look like faults."""
    if system.form != STORED or not system.projector.rows_are_single_rays:
        return system
    try:
        return system.with_linear_basis(options.supersample)
    except ValueError:  # too large, or a camera beside which the grid's centre lies
        return system


def _thinned(system: LinearSystem, kept: NDArray[np.int64], options: Options) -> LinearSystem:
    """Return the stored equations of some of a system's pixels."""
    masks, pointers = [], system.projector.view_ptr
    for number, (camera, pixels) in enumerate(zip(system.rig, system.pixels, strict=True)):
        own = kept[(kept >= pointers[number]) & (kept < pointers[number + 1])]
        width, height = camera.image_size
        mask = np.zeros(width * height, bool)
        mask[pixels[own - pointers[number]]] = True
        masks.append(mask.reshape(height, width))
    return LinearSystem.from_rig(
        system.rig,
        system.projector.grid,
        masks=masks,
        active=system.projector.active,
        skip=False,
        tracer=options.tracer,
        supersample=options.supersample,
        form=STORED,
    )
