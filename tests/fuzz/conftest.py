"""A watched reading for every test of readers: time, memory, files written, one line."""

import sys
import time
from pathlib import Path

import pytest

HERE = Path(__file__).parent
sys.path += [str(HERE), str(HERE.parent / "rigs" / "recordings")]  # for `samples`, `film_files`

MOST_SECONDS = 3.0  # of processor time for one small file; what backtracks takes minutes
MOST_MEMORY = 250 << 20  # bytes for one small file: bombs unpack to 300 MB
STATUS, FORGET = Path("/proc/self/status"), Path("/proc/self/clear_refs")


def peak_memory():
    """Return the largest memory of this process since `forget_peak`, in bytes; 0 if unknown."""
    if not FORGET.exists():
        return 0
    return int(STATUS.read_text().partition("VmHWM:")[2].split(maxsplit=1)[0]) << 10


@pytest.fixture(scope="session")
def read_or_refused():
    """Return a function that reads one file and fails unless the end is a good one.

    ``check(read, path, folder)``: the file is read, or refused by one line of ValueError or
    OSError that names the folder or a file in it; quickly, in little memory, and without writing a
    file. Returns the line, or None.
    """

    def check(read, path, folder):
        before = sorted(folder.rglob("*"))
        if FORGET.exists():
            FORGET.write_text("5")
        floor, began = peak_memory(), time.process_time()
        refusal = None
        try:
            read(path)
        except (ValueError, OSError) as error:
            refusal = str(error)
        assert time.process_time() - began < MOST_SECONDS
        assert peak_memory() - floor < MOST_MEMORY
        assert sorted(folder.rglob("*")) == before
        if refusal is not None:
            assert len(refusal.splitlines()) == 1, refusal
            assert any(one.name in refusal for one in (folder, *before))
        return refusal

    return check
