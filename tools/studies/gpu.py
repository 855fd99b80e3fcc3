"""All that needs a GPU: ``python tools/studies/gpu.py [--size full] [--data FOLDER]``.

It compiles the kernels, runs the tests marked ``gpu`` (the device's bits are the host build's),
and measures what `studies.benchmark.gpu` does, in some minutes. Without a device it says in one
line what is missing.
"""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
import time
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
sys.path[:0] = [str(ROOT), str(ROOT / "tools")]

from studies.benchmark.gpu import SIZES, check, run  # noqa: E402
from studies.common.page import markdown, said  # noqa: E402
from studies.common.study import Request  # noqa: E402
from tomo.operators.gpu import CudaDevice  # noqa: E402

TESTS = ROOT / "tests/tomo/operators/gpu"


def tested() -> int:
    """Run the tests marked ``gpu``, with their own fixtures alone; return the exit code."""
    paths = [str(ROOT), str(ROOT / "tools"), str(TESTS), os.environ.get("PYTHONPATH", "")]
    command = ["-m", "pytest", "-q", "-n", "0", "-m", "gpu", "-rs", "-p", "host_build"]
    command += [f"--confcutdir={TESTS}", str(TESTS)]
    environment = os.environ | {"PYTHONPATH": os.pathsep.join(filter(None, paths))}
    return subprocess.run(
        [sys.executable, *command], cwd=ROOT, env=environment, check=False
    ).returncode


def main() -> int:
    """Check and measure; return the exit code."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--size", choices=SIZES, default="quick")
    parser.add_argument("--data", type=Path, help="A folder of real image sets.")
    parser.add_argument("--device", default="cuda")
    wanted = parser.parse_args()
    began = time.perf_counter()

    def note(done: int, total: int, what: str) -> None:
        said(f"{time.perf_counter() - began:.0f} s: {what}")

    request = Request(wanted.size, 0, wanted.data, wanted.device, note)
    try:
        check(request)
    except ValueError as error:
        said(str(error))
        return 2
    said(CudaDevice().name)
    failed = tested()
    tables = run(request)
    for name, rows in tables.items():
        if rows:
            said(f"\n**{name}**\n\n{markdown(rows)}")
    wrong = [row for row in tables["errors"] if not row["holds"]]
    return failed or int(bool(wrong))


if __name__ == "__main__":
    sys.exit(main())
