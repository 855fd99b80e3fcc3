"""CUDA's compiler takes the kernels; no device is needed for that."""

import ctypes
import importlib.util
import re
import shutil
import subprocess
from pathlib import Path

import pytest

from tomo.operators.gpu.device import OPTIONS
from tomo.operators.gpu.kernels import NAMES, source

MOST = {"forward_1": 50, "adjoint_1": 50}
"""Instructions in the walk's loop, all three axes; a crossing runs through two thirds of them."""


def by_nvcc(text, folder):
    (folder / "kernels.cu").write_text(text, "utf-8")
    command = ["nvcc", "--ptx", *OPTIONS, "-arch=sm_90", "-o", "kernels.ptx", "kernels.cu"]
    done = subprocess.run(command, cwd=folder, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    return (folder / "kernels.ptx").read_text("utf-8")


def by_nvrtc(text, library):
    nvrtc, program = ctypes.CDLL(str(library)), ctypes.c_void_p()
    flags = [option.encode() for option in (*OPTIONS, "--gpu-architecture=compute_90")]
    none = (None, 0, None, None)
    assert nvrtc.nvrtcCreateProgram(ctypes.byref(program), text.encode(), *none) == 0
    failed = nvrtc.nvrtcCompileProgram(program, len(flags), (ctypes.c_char_p * len(flags))(*flags))
    size = ctypes.c_size_t()
    if failed:
        nvrtc.nvrtcGetProgramLogSize(program, ctypes.byref(size))
        log = ctypes.create_string_buffer(size.value)
        nvrtc.nvrtcGetProgramLog(program, log)
        raise AssertionError(log.value.decode())
    nvrtc.nvrtcGetPTXSize(program, ctypes.byref(size))
    ptx = ctypes.create_string_buffer(size.value)
    nvrtc.nvrtcGetPTX(program, ptx)
    return ptx.value.decode()


def wheels():
    """Return NVRTC's libraries from NVIDIA's wheels."""
    spec = importlib.util.find_spec("nvidia")
    folders = [Path(one) for one in (spec.submodule_search_locations if spec else ())]
    return [path for folder in folders for path in folder.rglob("libnvrtc.so.*[0-9]")]


@pytest.fixture(scope="module", params=["float32", "float64"])
def ptx(request, tmp_path_factory):
    text = source(request.param)
    if libraries := wheels():
        return by_nvrtc(text, libraries[0])
    if shutil.which("nvcc") is None:
        pytest.skip("no compiler for CUDA: found neither nvcc nor the wheel nvidia-cuda-nvrtc")
    return by_nvcc(text, tmp_path_factory.mktemp("ptx"))


def body_of(ptx, kernel):
    return re.search(rf"\.entry {kernel}\(.*?\n}}", ptx, re.DOTALL).group().splitlines()


def innermost_loop(lines):
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


def test_every_kernel_is_there(ptx):
    assert {*re.findall(r"\.entry (\w+)\(", ptx)} == {*NAMES}


def test_products_and_sums_stay_apart(ptx):
    """Device and host give the same bits only so."""
    assert not re.findall(r"\bfma\.|\bmad\.f|\.ftz|\.approx", ptx)
    assert not re.findall(r"\b(?:add|sub|mul)\.f(?:32|64)", ptx)  # .rn keeps them from contraction


@pytest.mark.parametrize("kernel", MOST)
def test_a_crossing_takes_few_instructions(ptx, kernel):
    loop = innermost_loop(body_of(ptx, kernel))
    assert any("ld.global" in line or "red.global" in line or "atom" in line for line in loop)
    assert 20 < len(loop) <= MOST[kernel]
    assert not [line for line in loop if "div" in line or "local" in line]
