"""Chart run time against error, with memory, threads, start-up, and the studies of accuracy."""

from __future__ import annotations

if __name__ == "__main__":
    from _entry import run

    run(__file__)  # before all other imports: from here on Ctrl-C and SIGTERM end it in one line

from studies.benchmark import STUDY
from studies.common.study import command

app = command(STUDY)
