"""Which scenes a half has: families crossed with rigs and noises, so that each meets many."""

from __future__ import annotations

import hashlib
from collections.abc import Iterable

from studies.scenes.exposure import NOISES, TWELVE_BIT
from studies.scenes.faults import FAULTS, SIZES
from studies.scenes.fields import REPORT, SETTLE, SPECIAL_REPORT, SPECIAL_SETTLE
from studies.scenes.recipe import SEEDS, Recipe

RIGS = (
    "ring-5", "dome-6", "half-ring-6", "unlike-8", "ring-8", "two-level-12", "half-ring-12",
    "unlike-12", "dome-12", "ring-24", "two-level-24", "dome-33",
)  # fmt: skip

FAMILIES = {"settle": tuple(SETTLE), "report": tuple(REPORT), "fresh": tuple(REPORT)}
SPECIAL = {
    "settle": tuple(SPECIAL_SETTLE),
    "report": tuple(SPECIAL_REPORT),
    "fresh": tuple(SPECIAL_REPORT),
}
SPECIAL_RIGS = ("narrow-6", "narrow-8", "narrow-12"), ("ring-6", "dome-8", "two-level-12")
"""Rigs that cut flames beside the axis, and those that see what no view resolves."""

SCENES = {"settle": 5, "report": 9, "fresh": 9}  # faultless scenes of each family, by half
ALARMS = {"settle": 200, "report": 200, "fresh": 60}
"""Further scenes in which nothing should be said to be wrong."""

FAULTY = {
    "settle": (
        ("tilted cone", "interacting jets", "smoke sheets"),
        ("ring-8", "two-level-12", "dome-24"),
    ),
    "report": (
        ("hollow swirl", "separate blobs", "branching fingers"),
        ("half-ring-8", "ring-12", "two-level-24"),
    ),
    "fresh": (
        ("hollow swirl", "averaged jet", "separate blobs", "branching fingers"),
        ("ring-7", "half-ring-10", "dome-16"),
    ),
}
"""The fields and the rigs that meet all faults."""

PAIRS = {"settle": 9, "report": 9, "fresh": 3}
"""Pairs of field and rig for each fault and size: all, or those that a hash puts first."""

FIRST_SPECIAL, FIRST_ALARM = 50, 100  # seeds from which those scenes count
QUICK_FAULTLESS, QUICK_VIEWS = 14, 12


def rank(*words: object) -> str:
    """Return what scenes are put in order by where some are chosen: a hash, which nobody chose."""
    return hashlib.sha256("/".join(map(str, words)).encode()).hexdigest()


def faultless(half: str, *, quick: bool = False) -> list[Recipe]:
    """Return the scenes that the error is measured on; one of each family when ``quick``."""
    found = []
    for number, family in enumerate(FAMILIES[half]):
        for turn in range(1 if quick else SCENES[half]):
            rig = RIGS[(7 * number + 5 * turn) % len(RIGS)]
            noise, seed = NOISES[(number + turn) % len(NOISES)], SEEDS[half] + turn
            found.append(Recipe(half, family, rig, noise, seed))
    return found


def special(half: str) -> list[Recipe]:
    """Return faultless scenes that are taken for faulty easily."""
    return [
        Recipe(half, family, rig, TWELVE_BIT, SEEDS[half] + FIRST_SPECIAL + turn)
        for family, rigs in zip(SPECIAL[half], SPECIAL_RIGS, strict=True)
        for turn, rig in enumerate(rigs)
    ]


def faulty(half: str) -> list[Recipe]:
    """Return the scenes with faults: all fields with all rigs; three pairs of the fresh half."""
    families, rigs = FAULTY[half]
    pairs = [(family, rig) for family in range(len(families)) for rig in range(len(rigs))]
    found = []
    for fault in FAULTS:
        for size in range(SIZES):
            order = {rank(half, fault, size, *pair): pair for pair in pairs}
            for family, rig in sorted(order[one] for one in sorted(order)[: PAIRS[half]]):
                seed = SEEDS[half] + 10 * family + rig
                where = half, families[family], rigs[rig], TWELVE_BIT, seed
                found.append(Recipe(*where, fault, size))
    return found


def alarms(half: str) -> list[Recipe]:
    """Return the faultless scenes that alarms are counted on."""
    families = FAMILIES[half]
    return [
        Recipe(
            half,
            families[number % len(families)],
            RIGS[(5 * number + number // len(RIGS)) % len(RIGS)],
            NOISES[number % len(NOISES)],
            SEEDS[half] + FIRST_ALARM + number,
        )
        for number in range(ALARMS[half])
    ]


def everything(half: str) -> list[Recipe]:
    """Return all scenes of a half, in an order that can end anywhere."""
    return _in_order([*faultless(half), *special(half), *alarms(half)], faulty(half))


def sample(half: str, faults: int = 1) -> list[Recipe]:
    """Return few and cheap scenes, stratified, in an order that can end anywhere.

    ``faults`` scenes of each fault, of unlike sizes, with at most `QUICK_VIEWS` views where there
    are such; `QUICK_FAULTLESS` from each family as many, and one of each special family.
    """
    wrong: list[Recipe] = []
    for fault in FAULTS:
        own = [one for one in faulty(half) if one.fault == fault]
        own.sort(key=lambda one: (one.views > QUICK_VIEWS, rank(one.name)))
        sizes = sorted(range(SIZES), key=lambda size: rank(half, fault, size))[:faults]
        wrong += [next(one for one in own if one.size == size) for size in sizes]
    plain: list[Recipe] = []
    each = -(-QUICK_FAULTLESS // len(FAMILIES[half]))
    for family in FAMILIES[half]:
        own = _cheapest([one for one in faultless(half) if one.family == family])
        plain += own[:each]
    cheap = _cheapest(special(half))
    odd = [next(one for one in cheap if one.family == family) for family in SPECIAL[half]]
    return _in_order(plain[:QUICK_FAULTLESS] + odd, wrong)


def _cheapest(recipes: Iterable[Recipe]) -> list[Recipe]:
    return sorted(recipes, key=lambda one: (one.views, rank(one.name)))


def _in_order(right: Iterable[Recipe], wrong: Iterable[Recipe]) -> list[Recipe]:
    """Return scenes by their hash, each faulty one behind the same scene without its fault."""
    order = sorted([*right, *wrong], key=lambda one: rank(one.name))
    return list(dict.fromkeys(both for one in order for both in (one.faultless, one)))
