"""What is compiled on first use is compiled before anything is timed."""

import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[3]

COMPILED_LATER = """
import inspect
import sys
from numba.core.dispatcher import Dispatcher
from tomo import Scan, VoxelGrid, load_scan
from tomo.pipeline.first_use import warm_up_stages
from tomo.pipeline import Options, reconstruct

def is_kernel(value):
    return isinstance(value, Dispatcher)

def known():
    modules = [module for name, module in sys.modules.items() if name.startswith("tomo")]
    values = [inspect.unwrap(one, stop=is_kernel) for m in modules for one in vars(m).values()]
    kernels = filter(is_kernel, values)
    return {(one.py_func.__qualname__, str(s)) for one in kernels for s in one.signatures}

warm_up_stages("march", carving=True)
before = known()
grid = VoxelGrid((20, 40, 20), 0.5, (1.0, -2.0, 0.5))
for basis in ("voxel", "linear"):
    outcome = reconstruct(
        load_scan(sys.argv[1]), grid, Options(method="sirt", iterations=2, basis=basis)
    )
assert 4096 < outcome.counts["active_voxels"] < grid.size  # some dead, and many others
assert before
print(*sorted(name for name, _ in known() - before))
"""


def test_nothing_is_compiled_while_a_reconstruction_is_timed(folder):
    run = subprocess.run(
        [sys.executable, "-c", COMPILED_LATER, str(folder)],
        cwd=ROOT,
        capture_output=True,
        text=True,
    )
    assert run.returncode == 0, run.stderr
    assert run.stdout.split() == [], run.stdout
