import os
import subprocess
import sys

import psutil
import pytest

from tomo._compute import memory


def test_no_more_than_the_system_has():
    assert 0 < memory.available_memory() <= psutil.virtual_memory().total


def test_a_limit_of_the_address_space_counts():
    code = (
        "import resource; from tomo._compute import memory;"
        "resource.setrlimit(resource.RLIMIT_AS, (8 << 30, -1));"
        "print(memory.available_memory())"
    )
    found = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=True
    )
    assert 0 < int(found.stdout) < 8 << 30


@pytest.mark.skipif(not hasattr(os, "sched_setaffinity"), reason="Linux only")
def test_cores_of_others_ask_for_no_address_space():
    code = (
        "import os; from tomo._compute import memory;"
        "os.cpu_count = lambda: 1000;"
        "memory._address_space = lambda: 4 << 30;"
        "os.sched_setaffinity(0, {min(os.sched_getaffinity(0))});"
        "memory.check_address_space()"
    )
    subprocess.run([sys.executable, "-c", code], check=True)


def test_peak_is_at_least_what_is_resident():
    resident = psutil.Process().memory_info().rss
    assert memory.peak_memory() >= 0.9 * resident
