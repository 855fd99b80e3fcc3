"""How much is gained where chord lengths are not the truth by learning what they lack."""

from __future__ import annotations

import collections
import itertools
import statistics
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any

from _benchmark.classic import CLASSIC, INFORMED, courses_of, of_splines
from _benchmark.mismatch_scenes import NOISES, MismatchScene, mismatch_scene
from _benchmark.sizes import TINY, Sizes
from _benchmark.solvers import Progress, Rows, seconds_of
from _benchmark.workers import results_of
from tomo import metrics
from tomo.pipeline.methods import AUTO
from tomo.selection.basis import BOXES, SPLINES


@dataclass(frozen=True)
class MismatchRow:
    """The best classic method, one that knows the physics, and WERNet on one scene.

    Attributes
    ----------
    effect, flame, noise, seed
        The scene.
    classic : str
        The best of `CLASSIC`, each stopped where it is nearest to the truth.
    classic_pass : int
        Where that was.
    classic_cosine_distance, classic_nrmse, classic_seconds : float
        There; seconds since the images were in memory.
    tried : mapping
        The cosine distance that each of `CLASSIC` reached.
    informed_cosine_distance, informed_nrmse : float
        Of the best of `INFORMED` and ``classic``, so stopped, with the true weights in place of
        chords: about what the images allow. Of splines where no lens spreads the light.
    wernet_cosine_distance, wernet_nrmse, wernet_seconds : float
        Of ``reconstruct(method="wernet")``, asked to look for discs out of focus (``blur``) and
        to fit no gains: as it stops by itself.
    blur : float
        The diameter of those that it found; 0 for none.
    default_cosine_distance : float
        Of WERNet not so asked.
    """

    effect: str
    flame: str
    noise: str
    seed: int
    classic: str
    classic_pass: int
    classic_cosine_distance: float
    classic_nrmse: float
    classic_seconds: float
    tried: Mapping[str, float]
    informed_cosine_distance: float
    informed_nrmse: float
    wernet_cosine_distance: float
    wernet_nrmse: float
    wernet_seconds: float
    blur: float
    default_cosine_distance: float

    @property
    def scene(self) -> tuple[str, str, str, int]:
        """What the row is of, as `mismatch_row` takes it."""
        return self.effect, self.flame, self.noise, self.seed


def mismatch(
    sizes: Sizes,
    progress: Progress,
    *,
    kept: Sequence[Mapping[str, Any]] = (),
    keep: Callable[[list[dict[str, Any]]], None] = lambda rows: None,
    processes: int = 1,
) -> Rows:
    """Return ``mismatch``, one row a scene, and ``mismatch_mean``, over the seeds.

    Parameters
    ----------
    sizes : Sizes
    progress : callable
    kept : sequence of mapping
        Rows of an interrupted run: their scenes are left out.
    keep : callable
        Is given all rows after each that is new.
    processes : int
        How many work on scenes side by side, see `_benchmark.workers.results_of`.
    """
    # Means need every seed of a noise: those without noise, which the aims are for, come first.
    order = [
        (effect, flame, noise, seed)
        for noise in NOISES
        for seed in sizes.mismatch_seeds
        for effect, flame in itertools.product(sizes.mismatch_effects, sizes.flames)
    ]
    rows = [MismatchRow(**row) for row in kept]
    had = {row.scene for row in rows}
    missing = [scene for scene in order if scene not in had]
    progress(len(rows), len(order), "first use")
    mismatch_row("gains", "jet", "clean", 0, TINY)
    for row in results_of(mismatch_row, [(*scene, sizes) for scene in missing], processes):
        rows.append(row)
        progress(len(rows), len(order), "{}, {}, {}, seed {}".format(*row.scene))
        keep([asdict(row) for row in rows])
    shown = [*itertools.product(sizes.mismatch_effects, sizes.flames, NOISES)]
    rows.sort(key=lambda row: (shown.index(row.scene[:3]), row.seed))
    return {"mismatch": [asdict(row) for row in rows], "mismatch_mean": means(rows)}


def mismatch_row(effect: str, flame: str, noise: str, seed: int, size: Sizes) -> MismatchRow:
    """Return what all methods make of one scene, see `mismatch_scene`."""
    scene = mismatch_scene(effect, flame, noise, seed, size)
    ready = scene.problem(midpoints=True)
    problems = {BOXES: ready, SPLINES: of_splines(ready)}
    courses = courses_of(problems, scene.truth, CLASSIC, size.passes)
    best = min(courses, key=lambda name: courses[name].least)
    went = courses[best]
    alike = [one for one in CLASSIC if one in INFORMED or one.name == best]
    told = {
        basis: replace(one, system=replace(one.system, projector=projector))
        for basis, one in problems.items()
        if (projector := scene.informed(one.system)) is not None
    }
    informed = courses_of(told, scene.truth, alike, size.passes)
    limit = min(informed.values(), key=lambda course: course.least)
    return MismatchRow(
        effect,
        flame,
        noise,
        seed,
        classic=best,
        classic_pass=went.best,
        classic_cosine_distance=went.least,
        classic_nrmse=went.nrmses[went.best],
        classic_seconds=went.seconds[went.best],
        tried={name: course.least for name, course in courses.items()},
        informed_cosine_distance=limit.least,
        informed_nrmse=limit.nrmses[limit.best],
        **_learned(scene),
    )


def means(rows: Sequence[MismatchRow]) -> list[dict[str, Any]]:
    """Return means over the seeds, and ratios of means to the best classic method's."""
    groups: dict[tuple, list[MismatchRow]] = {}
    for row in rows:
        groups.setdefault((row.effect, row.flame, row.noise), []).append(row)
    found = []
    for (effect, flame, noise), group in groups.items():
        won = collections.Counter(row.classic for row in group)
        mean: dict[str, Any] = {
            "effect": effect,
            "flame": flame,
            "noise": noise,
            "seeds": len(group),
            "classic": " / ".join(name for name, _ in won.most_common()),
        }
        for key in asdict(group[0]):
            if key.startswith(("classic_", "informed_", "wernet_", "default_")):
                mean[key] = statistics.fmean(getattr(row, key) for row in group)
        classic = mean["classic_cosine_distance"]
        for name in ("informed", "wernet", "default"):
            mean[f"{name}_of_classic"] = mean[f"{name}_cosine_distance"] / classic
        found.append(mean)
    return found


def _learned(scene: MismatchScene) -> dict[str, float]:
    """Return what WERNet reaches, without the truth, with and without looking for discs."""
    found = scene.learned(blur=AUTO)
    blur = found.settings["blur"]
    default = scene.learned() if blur else found
    return {
        "wernet_cosine_distance": metrics.cosine_distance(found.volume, scene.truth),
        "wernet_nrmse": metrics.nrmse(found.volume, scene.truth),
        "wernet_seconds": seconds_of(found),
        "blur": blur,
        "default_cosine_distance": metrics.cosine_distance(default.volume, scene.truth),
    }
