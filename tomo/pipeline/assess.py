"""Stage 9, assess: how far the volume, and the cameras that it was made from, can be trusted."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tomo.operators.operator import ProjectionOperator
from tomo.operators.system import Progress
from tomo.pipeline.check_options import repeats_of
from tomo.pipeline.methods import AUTO, method_named
from tomo.pipeline.options import Options
from tomo.pipeline.solve import Solved, choice_of, repeatable, voxel_means_of
from tomo.pipeline.stage import Record, as_warning, timed
from tomo.selection import solve_as_chosen
from tomo.uncertainty import Assessment, Solve, SolveOf
from tomo.uncertainty import assess as assess_volume


@dataclass(frozen=True, eq=False)
class Assessed:
    """The uncertainty of the volume, and which voxels no camera sees."""

    uncertainty: Assessment | None
    unseen: NDArray[np.bool_]  # (nx, ny, nz): no usable ray of any camera crosses
    record: Record = Record()


def assess(
    solved: Solved,
    options: Options,
    progress: Progress | None = None,
    light_error: float = 0.0,
) -> Assessed:
    """Solve a known answer like the volume with new noise, and see how far off that is.

    ``light_error`` is what else is not known of the total light, relative.
    """
    uncertainty = None
    system, unseen = solved.system, solved.built.system.unseen
    with timed() as stage:
        with as_warning("uncertainty: not found", stage.warnings):
            chosen = method_named(options.method).name == AUTO
            uncertainty = assess_volume(
                system.on_voxel_means,
                solved.built.measured,
                solved.solution.volume,
                repeatable(solved, options),
                solve_of=solver_of(solved) if chosen else None,
                cuttable=system.projector,
                light_error=light_error,
                repeats=repeats_of(options),
                seed=options.seed,
                progress=progress,
            )
        stage.warnings += _unseen_warning(unseen)
    return Assessed(uncertainty, unseen, stage.record)


def solver_of(solved: Solved) -> SolveOf:
    """Return the default's solve, as it was chosen, of everything or of a part."""
    choice, whole, weights = choice_of(solved), solved.system.projector, solved.built.weights

    def solve_of(part: ProjectionOperator | None, rows: NDArray[np.int64] | None) -> Solve:
        projector = whole if part is None else part
        own = weights if weights is None or rows is None else weights[rows]

        def solve(measured: NDArray[np.float32]) -> NDArray[np.float32]:
            found = solve_as_chosen(projector, measured, choice, weights=own)
            means = voxel_means_of(projector, projector.active.compress(found.volume))
            return projector.on_voxel_means.active.compress(means)

        return solve

    return solve_of


def _unseen_warning(unseen: NDArray[np.bool_]) -> list[str]:
    if not unseen.any():
        return []
    fraction = np.count_nonzero(unseen) / unseen.size
    how_many = f"{fraction:.1%}" if fraction >= 0.0005 else "less than 0.1%"
    return [
        f"{how_many} of the voxels are seen by no camera: their zero says nothing. Use a smaller "
        "grid"
    ]
