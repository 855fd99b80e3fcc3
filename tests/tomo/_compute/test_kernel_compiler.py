"""A kernel of many parts is translated once, and is what numba by itself would make of it."""

import os
import subprocess
import sys

import numba
import numpy as np
import pytest
from numba.core.codegen import CPUCodeLibrary

from tomo._compute import jit
from tomo._compute.jit import compiled

linked = pytest.importorskip(
    "tomo._compute.kernel_compiler", reason="numba's inner parts are others", exc_type=ImportError
)
if numba.version_info.short != jit._TRIED_WITH:
    pytest.skip("kernels are compiled as numba does it", allow_module_level=True)


def wave(x, scale):
    """Return something that takes an order of operations."""
    if scale < 0:
        raise ValueError("scale: negative")
    return np.sin(x * scale) / (1.0 + x * x) + x


helper = compiled(inline=True)(wave)
numba_alone = numba.njit(error_model="numpy")(wave)


def rows(call, decorate):
    """Return a kernel of two parallel loops, the second of which reads what the first wrote."""

    def kernel(values, scales, out):
        for row in numba.prange(len(values)):
            own = np.zeros(values.shape[1])
            for column in range(values.shape[1]):
                own[column] = call(values[row, column], scales[row])
            out[row] = own.sum()
        for row in numba.prange(len(values) - 1):
            scales[row] = call(out[row], 1.0) - out[row + 1]

    return decorate(kernel)


@pytest.fixture
def kernel():
    return rows(helper, compiled(parallel=True))


def data():
    random = np.random.default_rng(0)
    return random.normal(size=(50, 30)), random.random(50), np.zeros(50)


def test_a_kernel_gives_the_bits_that_numba_alone_gives(kernel):
    found, expected = data(), data()
    kernel(*found)
    rows(numba_alone, numba.njit(parallel=True, error_model="numpy"))(*expected)
    for one, other in zip(found, expected, strict=True):
        np.testing.assert_array_equal(one, other)
    assert found[2].any()


def test_of_all_parts_the_kernel_alone_is_optimised(monkeypatch):
    optimised = []
    optimise = CPUCodeLibrary._optimize_final_module

    def noting(library):
        optimised.append(library.name)
        optimise(library)

    monkeypatch.setattr(CPUCodeLibrary, "_optimize_final_module", noting)
    afresh = rows(compiled(inline=True)(wave), compiled(parallel=True))  # not from the cache
    afresh(*data())
    assert optimised == [afresh.py_func.__qualname__]


def test_helpers_have_no_machine_code_and_kernels_have(kernel):
    kernel(*data())
    (made,) = kernel.overloads.values()
    assert not isinstance(made.library, linked.LinkedLibrary)
    assert made.library.get_pointer_to_function(made.fndesc.llvm_cpython_wrapper_name)
    assert helper.overloads
    for made in helper.overloads.values():
        assert isinstance(made.library, linked.LinkedLibrary)


def test_other_code_of_numba_is_compiled_as_ever(kernel):
    kernel(*data())

    @numba.njit
    def plain(x):
        return wave_of_numba(x, 2.0)

    wave_of_numba = numba.njit(wave)
    assert plain(0.5) == pytest.approx(wave(0.5, 2.0))
    assert wave_of_numba(0.5, 2.0) == pytest.approx(wave(0.5, 2.0))
    codegen = next(iter(plain.overloads.values())).library.codegen
    assert not {"create_library", "set_env"} & set(vars(codegen))
    assert numba.core.compiler.Flags is not linked.KernelFlags


def test_what_numba_made_for_kernels_is_not_given_to_others():
    def powers(base, count):
        if count > 3:
            raise ValueError("count: more than three")
        found = np.zeros(count)
        for k in range(count):
            found[k] = base**k
        return found.sum()

    @compiled()
    def kernel(base, count):
        return powers_of_kernels(base, count)

    powers_of_kernels = compiled(inline=True)(powers)
    plain = numba.njit(powers)
    assert kernel(3, 3) == plain(3, 3) == 13
    (made,) = plain.overloads.values()
    parts = made.library._linking_libraries
    assert parts
    assert not any(isinstance(part, linked.LinkedLibrary) for part in parts)
    for function in kernel, plain:
        with pytest.raises(ValueError, match="count: more than three"):
            function(3, 4)


def test_flags_of_kernels_are_alike_by_what_they_set_and_no_others():
    flags = linked.KernelFlags()
    assert flags == linked.KernelFlags()
    assert hash(flags) == hash(linked.KernelFlags())
    flags.nrt = False  # as by default
    assert flags == linked.KernelFlags()
    flags.nrt = True
    assert flags != linked.KernelFlags()
    assert flags == flags.copy()
    plain = numba.core.compiler.Flags()
    assert linked.KernelFlags() != plain
    assert plain != linked.KernelFlags()


def test_what_does_not_compile_says_so_and_leaves_nothing_behind(kernel):
    @compiled(parallel=True)
    def wrong(out):
        for row in numba.prange(len(out)):
            out[row] = helper(out[row])

    with pytest.raises(numba.TypingError, match="scale"):
        wrong(np.zeros(3))
    kernel(*data())


def comprehension(values):
    return np.array([2 * value for value in values])


def inner_function(values):
    def twice(value):
        return 2 * value

    return twice(values[0])


def text_with_a_value(values):
    if values[0] > 0:
        raise ValueError("found", values[0])
    return 0.0


@pytest.mark.parametrize("function", [comprehension, inner_function, text_with_a_value])
def test_what_is_left_out_for_kernels_is_refused(function):
    with pytest.raises(numba.core.errors.NumbaError):
        compiled()(function)(np.ones(3))


def test_whole_arrays_are_what_they_are():
    @compiled()
    def whole(values, none, out):
        if none is None:
            out[:] = 2 * values + out[0]
        return out.shape

    out = np.ones(3)
    assert whole(np.arange(3.0), None, out) == (3,)
    np.testing.assert_array_equal(out, [1, 3, 5])


CACHED = """
import numba
import numpy as np
from tomo._compute.jit import compiled

@compiled(inline=True)
def checked(x):
    if x < 0:
        raise ValueError("x: negative")
    return np.sqrt(x)

@compiled()
def plain(values):
    return checked(values[0])

@compiled(parallel=True)
def roots(values, out):
    for k in numba.prange(len(values)):
        out[k] = checked(values[k])
"""

USED = """
import numpy as np
from cached import plain, roots
out = np.zeros(4)
roots(np.arange(4.0) ** 2, out)
try:
    plain(-np.ones(1))
except ValueError as error:
    print(*out, error, sum(roots.stats.cache_hits.values()), sum(plain.stats.cache_hits.values()))
"""


def test_a_cached_kernel_does_and_refuses_the_same_in_a_later_process(tmp_path):
    (tmp_path / "cached.py").write_text(CACHED)
    paths = os.pathsep.join([str(tmp_path), os.getcwd()])
    environment = os.environ | {"NUMBA_CACHE_DIR": str(tmp_path / "cache"), "PYTHONPATH": paths}
    found = []
    for _ in range(2):
        ran = subprocess.run(
            [sys.executable, "-c", USED], env=environment, capture_output=True, text=True
        )
        found.append(ran.stdout.strip() or ran.stderr)
    assert found == [f"0.0 1.0 2.0 3.0 x: negative {hits} {hits}" for hits in (0, 1)]
