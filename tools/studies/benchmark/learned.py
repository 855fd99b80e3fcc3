"""Learned weights against the default on optics that no formula has; see `studies.scenes.learned`.

Scenes of the half that rules are settled on, seen by an independent forward model, one process of
one thread.
"""

from __future__ import annotations

from pathlib import Path
from tempfile import TemporaryDirectory

from studies.common.study import Request, Tables
from studies.scenes import learned
from studies.scenes.trial import Trials

COLUMNS = learned.COLUMNS


def run(request: Request) -> Tables:
    """Return the errors of all methods on each scene, and their seconds."""
    with TemporaryDirectory() as folder:
        trials = Trials(Path(folder) / "scenes", Path(folder) / "rows", processes=1)
        quick = request.size != "full"
        tables = learned.learned(trials, "settle", quick=quick, progress=request.progress)
    tables.pop("scenes")
    return tables
