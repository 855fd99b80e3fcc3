"""The kernels in NVIDIA's assembler, which needs no device: what a face crossing costs."""

from __future__ import annotations

import ctypes
import importlib.util
import re
import shutil
import subprocess
from pathlib import Path
from tempfile import TemporaryDirectory

from tomo.operators.gpu.device import OPTIONS

ARCHITECTURE = "90"  # the architecture whose code is counted: Hopper, an H100 or H200


def compiled(text: str) -> str | None:
    """Return the PTX of CUDA C by NVRTC's wheel, or else by nvcc; None where neither is there."""
    if libraries := _wheels():
        return _by_nvrtc(text, libraries[0])
    return None if shutil.which("nvcc") is None else _by_nvcc(text)


def body_of(ptx: str, kernel: str) -> list[str]:
    """Return the lines of one kernel."""
    found = re.search(rf"\.entry {kernel}\(.*?\n}}", ptx, re.DOTALL)
    if found is None:
        raise ValueError(f"PTX: found no kernel {kernel}, expected it")
    return found.group().splitlines()


def innermost_loop(lines: list[str]) -> list[str]:
    """Return the instructions from a label to the last jump back to it, of the shortest loop.

    Jumps back to labels inside it are parts of the same loop: the walk passes one of three axes.
    """
    labels = {line.rstrip(":"): i for i, line in enumerate(lines) if line.startswith("$L")}
    loops = []
    for i, line in enumerate(lines):
        target = re.search(r"bra(?:\.uni)?\s+(\$L\w+);", line)
        if target and labels[target[1]] < i:
            loops.append((labels[target[1]], i))
    first, last = min(loops, key=lambda loop: loop[1] - loop[0])
    grown = True
    while grown:
        inner = [(a, b) for a, b in loops if a <= last and b >= first and b - a < 150]
        wider = min(a for a, _ in inner), max(b for _, b in inner)
        grown, (first, last) = wider != (first, last), wider
    return [line for line in lines[first : last + 1] if line.startswith("\t")]


def _wheels() -> list[Path]:
    """Return NVRTC's libraries from NVIDIA's wheels."""
    spec = importlib.util.find_spec("nvidia")
    folders = [Path(one) for one in (spec and spec.submodule_search_locations) or ()]
    return [path for folder in folders for path in folder.rglob("libnvrtc.so.*[0-9]")]


def _by_nvcc(text: str) -> str:
    with TemporaryDirectory() as folder:
        (Path(folder) / "kernels.cu").write_text(text, "utf-8")
        command = ["nvcc", "--ptx", *OPTIONS, f"-arch=sm_{ARCHITECTURE}"]
        command += ["-o", "kernels.ptx", "kernels.cu"]
        done = subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False)
        if done.returncode:
            raise ValueError(done.stderr)
        return (Path(folder) / "kernels.ptx").read_text("utf-8")


def _by_nvrtc(text: str, library: Path) -> str:
    nvrtc, program = ctypes.CDLL(str(library)), ctypes.c_void_p()
    options = (*OPTIONS, f"--gpu-architecture=compute_{ARCHITECTURE}")
    flags = [option.encode() for option in options]
    none = (None, 0, None, None)
    if nvrtc.nvrtcCreateProgram(ctypes.byref(program), text.encode(), *none):
        raise ValueError(f"{library}: found no compiler that starts, expected one")
    failed = nvrtc.nvrtcCompileProgram(program, len(flags), (ctypes.c_char_p * len(flags))(*flags))
    size = ctypes.c_size_t()
    if failed:
        nvrtc.nvrtcGetProgramLogSize(program, ctypes.byref(size))
        log = ctypes.create_string_buffer(size.value)
        nvrtc.nvrtcGetProgramLog(program, log)
        raise ValueError(log.value.decode())
    nvrtc.nvrtcGetPTXSize(program, ctypes.byref(size))
    ptx = ctypes.create_string_buffer(size.value)
    nvrtc.nvrtcGetPTX(program, ptx)
    return ptx.value.decode()
