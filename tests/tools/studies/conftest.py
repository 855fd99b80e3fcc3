"""Studies are imported as the commands in ``tools/`` import them."""

import sys
from pathlib import Path

import pytest

sys.path.append(str(Path(__file__).resolve().parents[3] / "tools"))


@pytest.fixture(scope="module", autouse=True)
def quiet_threads(on_threads):
    """Threads that spin while they wait for each other take most of a busy machine's time."""
    with pytest.MonkeyPatch.context() as patch, on_threads(1):
        patch.setenv("OMP_WAIT_POLICY", "passive")  # of processes that studies start
        yield
