"""Readers watched over hostile files: what they say, how long they take, what they ask for."""

import time
import tracemalloc

import pytest

SECONDS = 2.0  # of CPU time
MEMORY = 8 << 20  # bytes beyond four times the file


@pytest.fixture
def refused(tmp_path):
    """Return a function that reads a hostile file and returns the one line that it says.

    ``refused(read, name, content)`` writes the file first; nothing may be read but that file.
    """

    def run(read, name, content):
        path = tmp_path / name
        path.write_bytes(content)
        tracemalloc.start()
        began = time.process_time()
        try:
            with pytest.raises((ValueError, OSError)) as caught:
                read(path)
            seconds = time.process_time() - began
            taken = tracemalloc.get_traced_memory()[1]
        finally:
            tracemalloc.stop()
        said = str(caught.value)
        assert said.startswith(f"{path}: ")
        assert "\n" not in said
        assert seconds < SECONDS
        assert taken < MEMORY + 4 * len(content)
        assert "allocate" not in said  # nor was it tried and refused
        return said.removeprefix(f"{path}: ")

    return run
