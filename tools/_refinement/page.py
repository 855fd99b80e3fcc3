"""The page of the study."""

from __future__ import annotations

import statistics
from collections.abc import Mapping, Sequence
from typing import Any

from _benchmark.tables import Column, number, table, words

from _refinement.study import NOISE, NOMINAL, VIEWS

_RIG: list[Column] = [
    ("seed", number("seed")),
    ("before (px)", number("before_pixels", 2)),
    ("after (px)", number("after_pixels", 2)),
    ("accepted", words("accepted")),
    ("seconds", number("seconds", 2)),
]


def page(result: Mapping[str, Any]) -> str:
    """Return the page in Markdown."""
    machine, plume = result["machine"], result["plume"]
    lines = [
        "# Cameras refined from the flame",
        "",
        f"Made by `python tools/refinement_study.py{result['options']}`; {machine['cpu']}, "
        f"{machine['cores']} cores.",
        "",
        "## Rigs whose poses are wrong",
        "",
        f"{VIEWS} cameras in a ring, alternately from above and below, turbulent flame, "
        f"{NOISE:.0%} noise, 3 x 3 rays a pixel through voxels twice as fine as those "
        "reconstructed. Every camera is shifted and turned at random. Ray-miss is that of the "
        "rig against the true one over the volume, in pixels; wanted is less than 0.1 after. "
        "Settings were chosen on seeds 1 and 2.",
        "",
        table(result["disturbed_rigs"], _RIG),
        "",
        "## Rigs that are right",
        "",
        "The same flames, the cameras as they are: wanted is that nothing found is accepted, or "
        "less than 0.1 after.",
        "",
        table(result["true_rigs"], _RIG),
    ]
    if plume:
        figures = [name for name in plume[0] if name.endswith((" given", " refined"))]
        mean = {"held_out": "mean", "refined": ""}
        mean |= {name: statistics.fmean(row[name] for row in plume) for name in figures}
        columns: list[Column] = [("held out", words("held_out")), ("refined", words("refined"))]
        columns += [(name, number(name, 4)) for name in figures]
        lines += [
            "",
            "## The real plume",
            "",
            "ScalarFlow's five cameras, each predicted from the four others, PSNR in dB, the "
            f"whole default. {' and '.join(NOMINAL)} carry an average field of view. They are "
            "refined on the first frame, from which the rig goes to the second; the camera that "
            "is predicted takes no part in the refinement and stays as it was given. The "
            "settings of the acceptance were chosen with these two frames in view: there are "
            "no others.",
            "",
            table([*plume, mean], columns),
        ]
    return "\n".join(lines) + "\n"


def claims(result: Mapping[str, Sequence[Mapping[str, Any]]]) -> list[str]:
    """Return in words what was asked for and is not met, or not judged; empty where all is."""
    missed = [
        f"{which}, seed {row['seed']}: {row['after_pixels']:.3f} px, expected below 0.1"
        for which in ("disturbed rigs", "true rigs")
        for row in result[which.replace(" ", "_")]
        if not row["after_pixels"] < 0.1
    ]
    plume = result["plume"]
    if not plume:
        missed.append("plume: not judged")
    for name in [key for key in (plume[0] if plume else ()) if key.endswith(" given")]:
        given, refined = (
            statistics.fmean(row[key] for row in plume)
            for key in (name, name.replace("given", "refined"))
        )
        if not refined > given:
            missed.append(f"plume, {name}: {given:.2f} dB, refined {refined:.2f}, expected more")
    return missed
