"""Threads wait asleep whatever of the toolkit is loaded first, unless the user wants otherwise."""

import os
import subprocess
import sys

import pytest

CODE = """
import os, sys
class Watch:
    def find_spec(self, name, path=None, target=None):
        if name == "torch":
            print(name, os.environ.get("OMP_WAIT_POLICY"), flush=True)
            os._exit(0)  # what torch itself does is not asked
sys.meta_path.insert(0, Watch())
"""


@pytest.mark.parametrize(
    ("first", "asked"),
    [
        ("import tomo.wernet; tomo.wernet.WERNet", None),
        ("from tomo.wernet.paper import wernet_paper", None),
        ("import tomo._compute.jit, torch", None),
        ("import tomo._compute.jit, torch", "active"),
        ("import tomo.pipeline.reconstruct, torch", None),
    ],
)
def test_who_loads_openmp_finds_what_was_asked_for(first, asked):
    """It is read when the library is loaded: whoever loads torch or numba's threads."""
    environment = {k: v for k, v in os.environ.items() if k != "OMP_WAIT_POLICY"}
    environment |= {"OMP_WAIT_POLICY": asked} if asked else {}
    ran = subprocess.run(
        [sys.executable, "-c", CODE + first],
        env=environment, capture_output=True, text=True, check=True,
    )  # fmt: skip
    assert ran.stdout.split("\n")[0] == f"torch {asked or 'passive'}"
