"""Which scenes a half has: families crossed with rigs and noises, so that each meets many."""

from __future__ import annotations

from studies.scenes.faults import FAULTS, SIZES
from studies.scenes.recipe import HALVES, Recipe
from studies.scenes.recording import NOISES, TWELVE_BIT

RIGS = (
    "ring-5", "dome-6", "half-ring-6", "unlike-8", "ring-8", "two-level-12", "half-ring-12",
    "unlike-12", "dome-12", "ring-24", "two-level-24", "dome-33",
)  # fmt: skip

SCENES = {"settle": 5, "report": 9}
"""Faultless scenes of each family, by half."""

FAULTY = {
    "settle": (
        ("tilted cone", "interacting jets", "smoke sheets"),
        ("ring-8", "two-level-12", "dome-24"),
    ),
    "report": (
        ("hollow swirl", "separate blobs", "branching fingers"),
        ("half-ring-8", "ring-12", "two-level-24"),
    ),
}
"""The three fields and the three rigs that meet all faults."""

ALARMS = 200
"""Faultless scenes in which nothing should be said to be wrong."""

SEEDS = {"settle": 0, "report": 1000}
FIRST_ALARM = 100
"""Seed from which those scenes count."""


def faultless(half: str, *, quick: bool = False) -> list[Recipe]:
    """Return the scenes that the error is measured on; one of each family when ``quick``."""
    found = []
    for number, family in enumerate(HALVES[half]):
        for turn in range(1 if quick else SCENES[half]):
            rig = RIGS[(7 * number + 5 * turn) % len(RIGS)]
            noise, seed = NOISES[(number + turn) % len(NOISES)], SEEDS[half] + turn
            found.append(Recipe(half, family, rig, noise, seed))
    return found


def faulty(half: str, *, quick: bool = False) -> list[Recipe]:
    """Return the scenes with faults: all fields with all rigs, or one of each when ``quick``."""
    families, rigs = FAULTY[half]
    found = []
    for number, fault in enumerate(FAULTS):
        for size in range(SIZES):
            pairs = [(family, rig) for family in range(3) for rig in range(3)]
            if quick:
                pairs = [((number + size) % 3, (number // 3 + size) % 3)]
            for family, rig in pairs:
                seed = SEEDS[half] + 10 * family + rig
                where = half, families[family], rigs[rig], TWELVE_BIT, seed
                found.append(Recipe(*where, fault, size))
    return found


def alarms(half: str, *, quick: bool = False) -> list[Recipe]:
    """Return the faultless scenes that alarms are counted on; none when ``quick``."""
    families = HALVES[half]
    return [
        Recipe(
            half,
            families[number % len(families)],
            RIGS[(5 * number + number // len(RIGS)) % len(RIGS)],
            NOISES[number % len(NOISES)],
            SEEDS[half] + FIRST_ALARM + number,
        )
        for number in range(0 if quick else ALARMS)
    ]
