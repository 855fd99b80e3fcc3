"""Outer iterations of gas that absorbs its own light, until it absorbs what it emits."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from tomo._compute.reductions import norm
from tomo.pipeline.options import Options
from tomo.pipeline.solve import Solved, repeatable
from tomo.pipeline.trace import through_gas

OUTER = 3
"""Solves at most, each through gas with the emission of the one before."""

SETTLED = 1e-3
"""Relative change of the predicted images by other emission in front, below which another solve
is in vain: noise is larger."""


def with_own_absorption(solved: Solved, options: Options) -> Solved:
    """Return the solution that is seen through gas of its own emission.

    As it stands where nothing absorbs by its emission. The first solve was through gas of a quick
    volume; it is repeated as it was chosen until the images no longer change.
    """
    absorption = solved.built.absorption
    if not absorption.emission:
        return solved
    for _ in range(OUTER):
        built, volume = solved.built, solved.solution.volume
        system = through_gas(built.system, absorption, volume, options)
        old, new = (one.on_voxel_means.projector for one in (built.system, system))
        unknowns = new.active.compress(volume)
        before, after = old @ unknowns, new @ unknowns
        solved = replace(solved, built=replace(built, system=system))
        again = repeatable(solved, options)
        if again is None or norm(after - before) <= SETTLED * norm(after):
            break
        found = again(built.measured)
        residual = norm(built.measured - new @ found) / (norm(built.measured) or 1.0)
        history = solved.solution.history
        last = replace(history[-1], relative_residual=float(residual))
        volume = new.active.expand(found).reshape(new.grid.shape).astype(np.float32)
        solution = replace(solved.solution, volume=volume, history=(*history[:-1], last))
        solved = replace(solved, solution=solution)
    return solved
