"""Stage 9, assess: how far the volume, and the cameras that it was made from, can be trusted."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tomo.operators.system import Progress
from tomo.pipeline.check_options import repeats_of
from tomo.pipeline.options import Options
from tomo.pipeline.solve import Solved, repeatable
from tomo.pipeline.stage import Record, as_warning, timed
from tomo.uncertainty import Assessment
from tomo.uncertainty import assess as assess_volume


@dataclass(frozen=True, eq=False)
class Assessed:
    """The uncertainty of the volume, and whether views and cameras agree.

    Attributes
    ----------
    uncertainty : Assessment, optional
        None where it could not be found.
    unseen : (nx, ny, nz) bool
        True where no usable ray of any camera crosses the voxel.
    record : Record
    """

    uncertainty: Assessment | None
    unseen: NDArray[np.bool_]
    record: Record = Record()


def assess(
    solved: Solved,
    options: Options,
    progress: Progress | None = None,
) -> Assessed:
    """Repeat the solve with new noise, and without groups of views."""
    uncertainty = None
    system, unseen = solved.system, solved.built.system.unseen
    with timed() as stage:
        with as_warning("uncertainty: not found", stage.warnings):
            again = repeatable(solved, options)
            uncertainty = assess_volume(
                system.on_voxel_means,
                solved.built.measured,
                solved.solution.volume,
                again,
                by_views=again,
                repeats=repeats_of(options),
                seed=options.seed,
                progress=progress,
            )
            stage.warnings += [f"not to be trusted: {doubt}" for doubt in uncertainty.warnings]
        stage.warnings += _unseen_warning(unseen, options.unseen)
    return Assessed(uncertainty, unseen, stage.record)


def _unseen_warning(unseen: NDArray[np.bool_], value: str) -> list[str]:
    if not unseen.any():
        return []
    fraction = np.count_nonzero(unseen) / unseen.size
    how_many = f"{fraction:.1%}" if fraction >= 0.0005 else "less than 0.1%"
    return [
        f"{how_many} of the voxels are seen by no camera: their {value} says nothing. Use a "
        "smaller grid, or mark them with --unseen nan"
    ]
