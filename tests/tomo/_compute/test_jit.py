"""What is compiled is what the source says, from whatever version the cache is left over."""

import os
import subprocess
import sys

HELPER = """
from tomo._compute.jit import compiled

@compiled(inline=True)
def twice(x):
    return {factor} * x
"""

KERNEL = """
from helper import twice
from tomo._compute.jit import compiled

@compiled()
def kernel(x):
    return twice(x)
"""


def test_a_helper_in_another_file_is_not_outlived_by_a_cached_kernel(tmp_path):
    (tmp_path / "kernel.py").write_text(KERNEL)
    paths = os.pathsep.join([str(tmp_path), os.getcwd()])
    environment = os.environ | {
        "NUMBA_CACHE_DIR": str(tmp_path / "cache"),
        "PYTHONPATH": paths,
        "PYTHONDONTWRITEBYTECODE": "1",  # it tells sources by their length and second
    }
    count = (
        "from kernel import kernel; value = kernel(1.0); "
        "print(value, sum(kernel.stats.cache_hits.values()))"
    )
    found = []
    for factor in (2.0, 2.0, 3.0):
        (tmp_path / "helper.py").write_text(HELPER.format(factor=factor))
        ran = subprocess.run(
            [sys.executable, "-c", count], env=environment, capture_output=True, text=True
        )
        found.append(ran.stdout.split() or ran.stderr)
    assert found == [["2.0", "0"], ["2.0", "1"], ["3.0", "0"]]
