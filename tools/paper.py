"""Run the experiments of the WERNet paper again, and say what holds."""

from __future__ import annotations

if __name__ == "__main__":
    from _entry import run

    run(__file__)  # before all other imports: from here on Ctrl-C and SIGTERM end it in one line

from studies.common.study import command
from studies.paper import STUDY

app = command(STUDY)
