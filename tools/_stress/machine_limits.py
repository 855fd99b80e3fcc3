"""Too little memory, a full disk, a folder that cannot be written, and many threads."""

from __future__ import annotations

import os
import shutil
import subprocess
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np

from _stress.machine_commands import partial_files, run, volume_in
from _stress.row import Row, Size, relative_error, told


def threads(scan: Path, folder: Path) -> Iterator[Row]:
    """Reconstruct with different numbers of threads."""
    counts = (1, 3, 8)
    for method in ("auto", "tv", "wernet"):
        ends, volumes = [], []
        for count in counts:
            out = folder / f"{method}-{count}"
            number = str(count)
            environment = {"NUMBA_NUM_THREADS": number, "OMP_NUM_THREADS": number}
            ends.append(run("reconstruct", scan, "--method", method, "-o", out,
                            environment=environment))  # fmt: skip
            volumes.append(volume_in(out) if ends[-1].code == 0 else np.full(1, np.nan))
        worst = max(relative_error(volume, volumes[0]) for volume in volumes)
        yield Row(
            f"threads of numba and torch, method {method}",
            f"1 to {counts[-1]} threads",
            worst,
            1e-4 if method == "wernet" else 0.0,
            "relative difference from one thread",
            note=told([end.fault(0) for end in ends]),
        )


def memory(scan: Path, folder: Path, size: Size) -> Iterator[Row]:
    """Allow ever less address space: done, or refused in one line with exit code 2."""
    gigabytes = (0.5, 1.3) if size.quick else (0.3, 1.3, 2.0, 2.3, 4.0)
    for method, grid in (("auto", "6x10x6"), ("wernet", "6x10x6"), ("auto", "300x500x300")):
        if size.quick and (method, grid) != ("auto", "6x10x6"):
            continue
        faults, done = [], 0
        for limit in gigabytes:
            out = folder / f"memory-{method}-{grid}-{limit}"
            voxels = ("--grid", grid, "--spacing", 6 / int(grid.split("x")[0]))
            asked = (scan, "--method", method, "--iterations", 2, *voxels, "-o", out)
            end = run("reconstruct", *asked, limits={"AS": int(limit * 1e9)})
            whole = end.code != 0 or np.isfinite(volume_in(out)).all()
            fault = end.fault(0, 2) or ("" if whole else "a volume that is not finite")
            fault = fault or ", ".join(partial_files(out) if out.exists() else ())
            faults += [f"{limit} GB: {fault}"] if fault else []
            done += end.code == 0
            shutil.rmtree(out, ignore_errors=True)
        yield Row.of_faults(
            f"memory limited (ulimit -v), method {method}, {grid} voxels",
            f"{gigabytes[0]} to {gigabytes[-1]} GB of address space",
            faults,
            f"{done} of {len(gigabytes)} done, the others refused",
        )


def disk(scan: Path, folder: Path, size: Size) -> Iterator[Row]:
    """Write results to a disk that is full at some point; what was there has to stay."""
    sizes = (8,) if size.quick else (4, 40, 100, 300, 900)
    faults, hows = [], set()
    for kilobytes in sizes:
        with small_disk(folder / f"disk-{kilobytes}", kilobytes) as (place, limits, how):
            hows.add(how)
            earlier = place / "report.json"
            earlier.write_text("{}")
            for tool, arguments in _writing(scan, place)[size.quick :]:
                end = run(tool, *arguments, limits=limits)
                whole = end.code == 0 or earlier.read_text() == "{}"
                fault = end.fault(0, 1) or ("" if whole else "the earlier report is gone")
                fault = fault or ", ".join(partial_files(place))
                faults += [f"{tool}, {kilobytes} kB: {fault}"] if fault else []
    over = f"room for {', '.join(map(str, sizes))} kB ({told(hows)})"
    yield Row.of_faults("full disk while results are written", over, faults)


def read_only(scan: Path, folder: Path) -> Iterator[Row]:
    """Write results into a folder that cannot be written."""
    faults = []
    with locked_folder(folder / "locked") as (place, how):
        if place is None:  # nothing here keeps this user from writing
            return
        for tool, arguments in _writing(scan, place):
            fault = run(tool, *arguments).fault(1, 2)
            faults += [f"{tool}: {fault}"] if fault else []
        faults += [f"written: {path.name}" for path in place.iterdir()]
    yield Row.of_faults("read-only folder", f"simulate and reconstruct, {how}", faults)


def _writing(scan: Path, place: Path) -> list[tuple[str, list[object]]]:
    """Return commands that write into ``place``."""
    voxels = ["--grid", "6x10x6", "--spacing", 1]
    return [
        ("simulate", ["--rig", scan / "rig.yaml", "--phantom", "blobs", *voxels, "-o", place]),
        ("reconstruct", [scan, "--method", "sirt", "--iterations", 2, "-o", place]),
    ]


@contextmanager
def small_disk(place: Path, kilobytes: int) -> Iterator[tuple[Path, dict[str, int], str]]:
    """Yield a folder with little room, limits for the command, and how that was done.

    A file system in memory of that size where it can be mounted, else the system's limit on the
    size of one file.
    """
    place.mkdir(parents=True)
    if _mounted(place, f"size={kilobytes}k"):
        try:
            yield place, {}, "a file system of that size"
        finally:
            subprocess.run(["umount", place], check=True, capture_output=True)
    else:
        yield place, {"FSIZE": kilobytes * 1024}, "a limit on a file's size"


@contextmanager
def locked_folder(place: Path) -> Iterator[tuple[Path | None, str]]:
    """Yield an empty folder that cannot be written, None where that cannot be had, and how."""
    place.mkdir(parents=True)
    if hasattr(os, "geteuid") and os.geteuid() != 0:
        place.chmod(0o555)
        try:
            yield place, "without write permission"
        finally:
            place.chmod(0o755)
    elif _mounted(place, "size=64k,ro"):
        try:
            yield place, "mounted read-only"
        finally:
            subprocess.run(["umount", place], check=True, capture_output=True)
    else:
        yield None, ""


def _mounted(place: Path, options: str) -> bool:
    """Mount a file system in memory on ``place``; return whether this user can."""
    if shutil.which("mount") is None:
        return False
    command = ["mount", "-t", "tmpfs", "-o", options, "tmpfs", str(place)]
    return subprocess.run(command, capture_output=True).returncode == 0
