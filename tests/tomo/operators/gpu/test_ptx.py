"""CUDA's compiler takes the kernels; no device is needed for that."""

import re

import pytest
from studies.common.ptx import body_of, compiled, innermost_loop

from tomo.operators.gpu.device import NAMES, source

MOST = {"forward_1": 50, "adjoint_1": 50}
"""Instructions in the walk's loop, all three axes; a crossing runs through two thirds of them."""


@pytest.fixture(scope="module", params=["float32", "float64"])
def ptx(request):
    found = compiled(source(request.param))
    if found is None:
        pytest.skip("no compiler for CUDA: found neither nvcc nor the wheel nvidia-cuda-nvrtc")
    return found


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
