"""One scene by the default, in a process of its own; what it came to is kept on disk."""

from __future__ import annotations

import hashlib
import json
import time
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.stats import spearmanr

from rigs.files.text import plain, write_json
from studies.common.processes import MOST, at_work
from studies.common.scans import seconds_of
from studies.common.study import Progress
from studies.scenes.oracle import best_of
from studies.scenes.patches import patched
from studies.scenes.recipe import Recipe
from studies.scenes.scene import known_scene, warm_up
from tomo import Reconstruction
from tomo.uncertainty import summaries
from tomo.uncertainty.intervals import NORMAL

Row = dict[str, Any]


@dataclass(frozen=True)
class Trials:
    """How scenes are run."""

    cache: Path  # a folder of scenes and oracles, which serve all runs
    rows: Path  # a folder of what this run's scenes came to
    # fields of `tomo.Options` other than the default's
    options: Mapping[str, Any] = field(default_factory=dict)
    # constants of modules to other values, see `studies.scenes.patches`
    constants: Mapping[str, Any] = field(default_factory=dict)
    processes: int = MOST  # at work at a time, of one thread each
    resume: bool = False  # whether rows that are there are taken as they are

    def run(
        self, recipes: Sequence[Recipe], progress: Progress, *, oracle: bool = False
    ) -> list[Row]:
        """Return the row of each recipe, in their order; with ``oracle`` that of the best too."""
        paths = {recipe: self._path(recipe, oracle) for recipe in recipes}
        if not self.resume:
            for path in paths.values():
                path.unlink(missing_ok=True)
        missing = [recipe for recipe, path in paths.items() if not path.is_file()]
        how = self.cache, dict(self.options), dict(self.constants), oracle
        jobs = {recipe: (recipe, paths[recipe], *how) for recipe in missing}
        for done, (recipe, _) in enumerate(at_work(_write, jobs, self.processes)):
            progress(done + 1, len(missing), recipe.name)
        return [json.loads(paths[recipe].read_text("utf-8")) for recipe in recipes]

    def _path(self, recipe: Recipe, oracle: bool) -> Path:
        how = json.dumps([oracle, dict(self.options), dict(self.constants)], sort_keys=True)
        return self.rows / f"{recipe.key}-{hashlib.sha256(how.encode()).hexdigest()[:8]}.json"


def _write(
    recipe: Recipe,
    path: Path,
    cache: Path,
    options: Mapping[str, Any],
    constants: Mapping[str, Any],
    oracle: bool,
) -> None:
    """Run one scene and write its row."""
    write_json(path, plain(row_of(recipe, cache, options, constants, oracle=oracle)), indent=1)


def row_of(
    recipe: Recipe,
    cache: Path | None,
    options: Mapping[str, Any] | None = None,
    constants: Mapping[str, Any] | None = None,
    *,
    oracle: bool = False,
) -> Row:
    """Return what the default, or other ``options``, makes of a scene: errors and its report."""
    from tomo import Options, reconstruct

    scene = known_scene(recipe, cache)
    warm_up()
    started = time.process_time()
    with patched(constants or {}):
        outcome = reconstruct(scene.scan, None, Options.from_mapping(options or {}))
    spent = time.process_time() - started
    seconds = outcome.seconds
    quality = outcome.solution.quality
    row: Row = {
        **asdict(recipe),
        "views": recipe.views,
        "scene": recipe.name,
        "nrmse": quality["nrmse"],
        "cosine_distance": quality["cosine_distance"],
        "seconds": seconds_of(outcome),
        "cpu_seconds": spent,
        "method": outcome.solution.settings.get("method"),
        "learned": outcome.solution.weights is not None,
        "basis": outcome.basis.get("name"),
        "intervals": inside(outcome, scene.truth),
        "seconds_times": seconds["uncertainty"] / max(seconds["choose"], 1e-6),
    }
    if oracle:
        best = best_of(scene, cache)
        row |= {
            "best": best.name,
            "best_nrmse": best.nrmse,
            "best_cosine_distance": best.cosine_distance,
            "of_best": row["nrmse"] / best.nrmse,
            "cosine_of_best": row["cosine_distance"] / best.cosine_distance,
        }
    return row


EMITTING = 0.02  # fraction of the truth's peak above which a voxel counts


def inside(outcome: Reconstruction, truth: NDArray[np.float32]) -> dict[str, Any] | None:
    """Return what the intervals of a reconstruction are worth; None where it has none.

    ``coverage``, ``width`` (median half-width over median error) and ``rank`` (Spearman's, of
    half-width and error) of emitting voxels, the first also ``by_noise`` alone; ``total`` and
    ``edges`` (fraction) inside, ``planes`` (fraction of those with light), and the total's width.
    """
    found = outcome.uncertainty and outcome.uncertainty.intervals
    if not found:
        return None
    deviation = outcome.uncertainty.standard_deviation
    emitting = truth > EMITTING * truth.max()
    error = np.abs(outcome.solution.volume - truth)[emitting]
    half = found.half_width[emitting]
    grid = outcome.solution.grid
    true = summaries.split(summaries.all_of(truth, grid), grid)
    off = {name: np.abs(found.values[name] - true[name]) for name in true}
    planes = []
    for name in ("plane_sums_x", "plane_sums_y", "plane_sums_z"):
        lit = true[name] > EMITTING * true[name].max()
        planes.append((off[name] <= found.half_widths[name])[lit])
    return {
        "coverage": float(np.mean(error <= half)),
        "by_noise": float(np.mean(error <= NORMAL * deviation[emitting])),
        "width": float(np.median(half) / np.median(error)),
        "rank": float(spearmanr(half, error)[0]),
        "rank_by_noise": float(spearmanr(deviation[emitting], error)[0]),
        "total": bool(off["total"] <= found.half_widths["total"]),
        "total_error": float(off["total"] / true["total"]),
        "total_width": float(found.half_widths["total"] / true["total"]),
        "planes": float(np.mean(np.concatenate(planes))),
        "edges": float(np.mean(off["edges"] <= found.half_widths["edges"])),
    }
