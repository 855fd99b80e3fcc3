"""Stress the toolkit: wrong pixels, views and cameras, rigs that say too little, other units."""

from __future__ import annotations

if __name__ == "__main__":
    from _entry import run

    run(__file__)  # before all other imports: from here on Ctrl-C and SIGTERM end it in one line

from studies.common.study import command
from studies.stress import STUDY

app = command(STUDY)
