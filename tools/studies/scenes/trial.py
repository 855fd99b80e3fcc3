"""One scene by the default, in a process of its own; what it came to is kept on disk."""

from __future__ import annotations

import hashlib
import json
import multiprocessing
import os
from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from contextlib import contextmanager
from dataclasses import asdict, dataclass, field
from functools import cache as once
from pathlib import Path
from typing import Any

from rigs.files.json_file import plain, write_json
from studies.common.scans import seconds_of
from studies.common.study import Progress
from studies.scenes.answer import answer_of
from studies.scenes.inside import inside
from studies.scenes.oracle import best_of
from studies.scenes.patches import patched
from studies.scenes.recipe import Recipe
from studies.scenes.recording import TWELVE_BIT
from studies.scenes.scene import known_scene
from tomo.pipeline.answer import EXPLAINED

Row = dict[str, Any]

MOST_PROCESSES = 2


@dataclass(frozen=True)
class Trials:
    """How scenes are run.

    Attributes
    ----------
    cache : Path
        A folder of scenes and oracles, which serve all runs.
    rows : Path
        A folder of what this run's scenes came to.
    options : mapping
        Fields of `tomo.Options` other than the default's.
    constants : mapping
        Constants of modules to other values, see `studies.scenes.patches`.
    processes : int
        At work at a time, of one thread each.
    resume : bool
        Whether rows that are there are taken as they are.
    """

    cache: Path
    rows: Path
    options: Mapping[str, Any] = field(default_factory=dict)
    constants: Mapping[str, Any] = field(default_factory=dict)
    processes: int = MOST_PROCESSES
    resume: bool = False

    def run(
        self, recipes: Sequence[Recipe], progress: Progress, *, oracle: bool = False
    ) -> list[Row]:
        """Return the row of each recipe, in their order; with ``oracle`` that of the best too."""
        paths = {recipe: self._path(recipe, oracle) for recipe in recipes}
        if not self.resume:
            for path in paths.values():
                path.unlink(missing_ok=True)
        missing = [recipe for recipe, path in paths.items() if not path.is_file()]
        for done, recipe in enumerate(self._at_work(missing, paths, oracle)):
            progress(done + 1, len(missing), recipe.name)
        return [json.loads(paths[recipe].read_text("utf-8")) for recipe in recipes]

    def _path(self, recipe: Recipe, oracle: bool) -> Path:
        how = json.dumps([oracle, dict(self.options), dict(self.constants)], sort_keys=True)
        return self.rows / f"{recipe.key}-{hashlib.sha256(how.encode()).hexdigest()[:8]}.json"

    def _at_work(
        self, recipes: Sequence[Recipe], paths: Mapping[Recipe, Path], oracle: bool
    ) -> Iterator[Recipe]:
        """Yield recipes as their rows are written."""
        arguments = self.cache, dict(self.options), dict(self.constants), oracle
        with _one_thread_each(), _pool(self.processes) as pool:
            jobs = {pool.submit(_write, r, paths[r], *arguments): r for r in recipes}
            for job in as_completed(jobs):
                job.result()
                yield jobs[job]


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
    _warm_up()
    with patched(constants or {}):
        outcome = reconstruct(scene.scan, None, Options.from_mapping(options or {}))
    seconds = outcome.seconds
    answer = answer_of((*outcome.warnings, *_unexplained(outcome)), outcome.rig.names)
    quality = outcome.solution.quality
    row: Row = {
        **asdict(recipe),
        "views": recipe.views,
        "scene": recipe.name,
        "nrmse": quality["nrmse"],
        "cosine_distance": quality["cosine_distance"],
        "seconds": seconds_of(outcome),
        "method": outcome.solution.settings.get("method"),
        "strength": outcome.solution.settings.get("strength"),
        "basis": outcome.basis.get("name"),
        "at_fault": list(scene.at_fault),
        "cameras_named": list(answer.cameras),
        "causes_named": list(answer.causes),
        "silent": answer.silent,
        "warnings": list(outcome.warnings),
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


def _unexplained(outcome: Any) -> list[str]:
    """Return the sentence that the report begins with, where the images are not explained."""
    answer = outcome.report()["answer"]
    return [] if answer["verdict"] == EXPLAINED else [answer["sentence"]]


@once
def _warm_up() -> None:
    """Compile or load kernels, once a process: seconds are those of a process at work."""
    from tomo import reconstruct

    for views in (6, 12):
        recipe = Recipe("settle", "tilted cone", f"ring-{views}", TWELVE_BIT, 0)
        reconstruct(known_scene(recipe).scan)


def _pool(processes: int) -> ProcessPoolExecutor:
    return ProcessPoolExecutor(processes, multiprocessing.get_context("spawn"))


@contextmanager
def _one_thread_each() -> Iterator[None]:
    """Let processes that start meanwhile use one thread: two of them share two cores."""
    names = ("NUMBA_NUM_THREADS", "OMP_NUM_THREADS")
    before = {name: os.environ.get(name) for name in names}
    os.environ.update(dict.fromkeys(names, "1"))
    try:
        yield
    finally:
        for name, value in before.items():
            if value is None:
                del os.environ[name]
            else:
                os.environ[name] = value
