"""What every method promises alike."""

import json
import os
import subprocess
import sys
import warnings

import numpy as np
import pytest

from tomo import solvers
from tomo.grid import VoxelGrid
from tomo.operators import Projector
from tomo.trace import Segments

MULTIPLICATIVE = ("mart", "mlem", "smart")
RELAXED = ("art", "mart", "sart", "sirt", "smart")
ADDITIVE = tuple(name for name in solvers.METHODS if name not in MULTIPLICATIVE)
SMOOTHING = ("curvature", "tikhonov", "tv")
CASES = [(name, {}) for name in solvers.METHODS] + [
    ("cgls", {"strength": 0.01}),
    ("mlem", {"subsets": 4}),
    ("sirt", {"subsets": 4}),
]
every_method = pytest.mark.parametrize(("method", "settings"), CASES)


def _solve(method, projector, measured, settings=None, **more):
    return getattr(solvers, method)(
        projector, measured, **{"iterations": 5, **(settings or {}), **more}
    )


def _noisy(case, fraction=0.1, seed=0):
    noise = np.random.default_rng(seed).standard_normal(len(case.measured))
    return (case.measured + fraction * case.measured.max() * noise).astype(np.float32)


def _relative(found, expected):
    return np.linalg.norm(found - expected) / np.linalg.norm(expected)


@every_method
def test_volumes_are_never_negative(ring_system, method, settings):
    lowest = []

    def watch(index, volume, residual):
        lowest.append(volume.min())

    start = np.ones(ring_system.projector.shape[1])
    if method not in MULTIPLICATIVE:
        start[::3] = -1  # unseen voxels among them
    found = _solve(
        method, ring_system.projector, _noisy(ring_system), settings, start=start, callback=watch
    )
    assert min(lowest) >= 0
    assert found.volume.min() >= 0
    assert (_noisy(ring_system) < 0).any()


@pytest.mark.parametrize("method", ADDITIVE)
def test_additive_methods_may_go_below_zero_if_asked(ring_system, method):
    found = _solve(method, ring_system.projector, _noisy(ring_system), nonnegative=False)
    assert found.volume.min() < 0
    assert found.settings["nonnegative"] is False


@every_method
@pytest.mark.parametrize("factor", [1e-6, 1e6])
def test_brighter_images_give_a_brighter_volume(ring_system, method, settings, factor):
    case = ring_system
    expected = _solve(method, case.projector, case.measured, settings)
    found = _solve(method, case.projector, case.measured * np.float64(factor), settings)
    assert _relative(found.volume / factor, expected.volume) < 1e-5
    np.testing.assert_allclose(
        [line.relative_residual for line in found.history],
        [line.relative_residual for line in expected.history],
        rtol=1e-4,
    )


@every_method
@pytest.mark.parametrize("factor", [1e-30, 1e30])
def test_extreme_intensities_neither_overflow_nor_vanish(ring_system, method, settings, factor):
    case = ring_system
    expected = _solve(method, case.projector, case.measured, settings, iterations=10)
    measured = case.measured.astype(np.float64) * factor
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        found = _solve(method, case.projector, measured, settings, iterations=10)
    assert len(found.history) == len(expected.history)
    assert _relative(found.volume / np.float64(factor), expected.volume) < 1e-4


@every_method
@pytest.mark.parametrize("factor", [1e-6, 1e6])
def test_the_length_unit_only_rescales_the_volume(ring_system, method, settings, factor):
    case, s = ring_system, ring_system.projector.segments
    other = Projector(
        Segments(s.ptr, s.voxel, (s.length * factor).astype(np.float32)),
        VoxelGrid(case.projector.grid.shape, factor),
        case.projector.view_ptr,
    )
    expected = _solve(method, case.projector, case.measured, settings)
    found = _solve(method, other, case.measured, settings)
    assert _relative(np.asarray(found.volume) * factor, np.asarray(expected.volume)) < 1e-5


@pytest.mark.parametrize("method", ["cgls", "mlem", "nnls", "sirt", "smart", "tikhonov", "tv"])
def test_the_order_of_the_views_does_not_matter_to_simultaneous_methods(ring_system, method):
    case, views = ring_system, [4, 0, 8, 2, 6, 1, 7, 3, 5]
    expected = _solve(method, case.projector, case.measured)
    shuffled = case.measured[case.projector.pixels_of(views)]
    found = _solve(method, case.projector.subset(views), shuffled)
    assert _relative(found.volume, expected.volume) < 1e-5


@pytest.mark.parametrize(
    ("method", "settings"),
    [
        ("mlem", {}),
        ("mlem", {"subsets": 4}),
        ("sart", {}),
        ("sirt", {}),
        ("sirt", {"subsets": 4}),
        ("smart", {}),
    ],
)
def test_a_run_continues_from_its_own_result_bit_for_bit(ring_system, method, settings):
    case = ring_system
    whole = _solve(method, case.projector, case.measured, settings, iterations=7)
    first = _solve(method, case.projector, case.measured, settings, iterations=3)
    start = first.volume.copy()
    rest = _solve(method, case.projector, case.measured, settings, iterations=4, start=start)
    np.testing.assert_array_equal(rest.volume, whole.volume)
    np.testing.assert_array_equal(start, first.volume)  # the start itself is left alone
    assert rest.history[0].relative_residual == whole.history[3].relative_residual


@every_method
def test_history_holds_the_residuals_of_the_volumes_reported(ring_system, method, settings):
    case, seen = ring_system, []
    measured = _noisy(case)
    if method == "cgls":  # its residual is that of the unclipped volume
        settings = {**settings, "nonnegative": False}

    def watch(index, volume, residual):
        misfit = measured - case.projector @ volume.astype(np.float64)
        seen.append((index, residual, np.linalg.norm(misfit) / np.linalg.norm(measured)))

    found = _solve(method, case.projector, measured, settings, iterations=8, callback=watch)
    indices, reported, true = zip(*seen, strict=True)
    assert indices == tuple(range(9))
    np.testing.assert_allclose(reported, true, rtol=1e-5)
    assert [line.relative_residual for line in found.history] == list(reported)
    assert [line.index for line in found.history] == list(indices)
    assert found.relative_residual == reported[-1]
    assert found.settings["method"] == method
    assert found.settings["iterations"] == 8


@every_method
def test_the_callback_can_stop(ring_system, method, settings):
    case = ring_system
    stopped = _solve(
        method, case.projector, case.measured, settings, callback=lambda index, *_: index == 2
    )
    expected = _solve(method, case.projector, case.measured, settings, iterations=2)
    assert stopped.stop_reason == "stopped by the callback at iteration 2"
    np.testing.assert_array_equal(stopped.volume, expected.volume)


@every_method
def test_no_iteration_returns_the_start(ring_system, method, settings):
    case = ring_system
    start = np.random.default_rng(0).random(case.projector.grid.shape).astype(np.float32)
    found = _solve(method, case.projector, case.measured, settings, start=start, iterations=0)
    np.testing.assert_array_equal(found.volume, start)
    assert len(found.history) == 1


def _one_line(error):
    assert "\n" not in str(error.value)


@every_method
@pytest.mark.parametrize(
    ("bad", "message"),
    [
        ({"measured": np.ones(7)}, "measured: found 7 pixels, expected the projector's 2880"),
        ({"measured": np.full(2880, np.nan)}, "measured: found 2880 NaN or infinite pixels"),
        ({"measured": np.full(2880, 1e300)}, "measured: found 2880 NaN or infinite pixels"),
        ({"start": np.ones(3)}, "start: found shape"),
        ({"start": np.full(1400, np.inf)}, "start: found shape"),
        ({"start": np.full(1400, -1e300)}, "start: found shape"),
        ({"iterations": -1}, "iterations: found -1, expected a whole number >= 0"),
        ({"iterations": 2.5}, "iterations: found 2.5, expected a whole number >= 0"),
    ],
)
def test_bad_input_is_refused_in_one_line(ring_system, method, settings, bad, message):
    arguments = {"measured": ring_system.measured, **settings, **bad}
    with pytest.raises(ValueError, match=message) as error:
        _solve(method, ring_system.projector, **arguments)
    _one_line(error)


@pytest.mark.parametrize("method", MULTIPLICATIVE)
@pytest.mark.parametrize(
    ("bad", "message"),
    [
        ({"start": np.full(1400, -1.0)}, "start: found negative voxels"),
        ({"nonnegative": False}, "nonnegative: found False, expected True"),
    ],
)
def test_multiplicative_methods_refuse_what_is_negative(ring_system, method, bad, message):
    with pytest.raises(ValueError, match=message) as error:
        _solve(method, ring_system.projector, ring_system.measured, **bad)
    _one_line(error)


@pytest.mark.parametrize("method", RELAXED)
@pytest.mark.parametrize("relaxation", [0, -0.5, 2, np.nan, np.inf])
def test_relaxation_must_lie_between_zero_and_two(ring_system, method, relaxation):
    with pytest.raises(ValueError, match=r"relaxation: found .*, expected above 0") as error:
        _solve(method, ring_system.projector, ring_system.measured, relaxation=relaxation)
    _one_line(error)


@pytest.mark.parametrize("method", ["mlem", "sirt"])
@pytest.mark.parametrize("subsets", [0, -1, 2881, 2.5, np.nan])
def test_subsets_must_be_a_whole_number_of_pixels_or_fewer(ring_system, method, subsets):
    with pytest.raises(ValueError, match=r"subsets: found .*, expected a whole number") as error:
        _solve(method, ring_system.projector, ring_system.measured, subsets=subsets)
    _one_line(error)


@every_method
def test_dark_images_give_a_dark_volume_without_a_warning(ring_system, method, settings):
    projector = ring_system.projector
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        found = _solve(method, projector, np.zeros(projector.shape[0]), settings)
    np.testing.assert_array_equal(found.volume, 0)
    assert all(line.relative_residual == 0 for line in found.history)


@pytest.mark.parametrize(
    ("method", "settings"),
    [case for case in CASES if case[0] != "cgls"],  # CGLS clips what it found without bounds
)
def test_images_of_noise_below_zero_give_a_dark_volume(ring_system, method, settings):
    projector = ring_system.projector
    found = _solve(method, projector, np.full(projector.shape[0], -1.0), settings)
    np.testing.assert_array_equal(found.volume, 0)


@pytest.mark.parametrize(
    ("method", "settings"), [case for case in CASES if case[0] not in SMOOTHING]
)
def test_rays_that_miss_and_voxels_out_of_view_change_nothing(projector_of, method, settings):
    random = np.random.default_rng(0)
    matrix = random.uniform(0.2, 1, (12, 9))
    matrix[[0, 5, 11]] = 0
    matrix[:, [0, 4, 8]] = 0
    full = matrix @ random.uniform(0.5, 2, 9)
    settings = {**settings, "iterations": 3}  # before rounding shows in conjugate gradients
    full[[0, 5, 11]] = 7.0  # light that no voxel can explain
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        found = _solve(method, projector_of(matrix), full, settings).volume.ravel()
    np.testing.assert_array_equal(found[[0, 4, 8]], 0)
    rows, columns = np.ix_(matrix.any(axis=1), matrix.any(axis=0))
    if method in ("cgls", "nnls", "sirt", "sart") and "subsets" not in settings:
        # Those whose order and start do not depend on them
        small = projector_of(matrix[rows, columns])
        expected = _solve(method, small, full[rows.ravel()], settings)
        np.testing.assert_allclose(found[columns.ravel()], expected.volume.ravel(), rtol=1e-5)
    assert found[columns.ravel()].max() > 0.1


@every_method
def test_a_scan_that_sees_nothing_gives_a_dark_volume(projector_of, method, settings):
    projector = projector_of(np.zeros((4, 3)))
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        found = _solve(method, projector, np.ones(4), settings)
    np.testing.assert_array_equal(found.volume, 0)


@every_method
def test_views_without_pixels_change_nothing(ring_system, method, settings):
    case = ring_system
    ptr = case.projector.view_ptr
    padded = Projector(
        case.projector.segments, case.projector.grid, np.repeat(ptr, 1 + (ptr == 0))
    )
    expected = _solve(method, case.projector, case.measured, settings)
    found = _solve(method, padded, case.measured, settings)
    np.testing.assert_array_equal(found.volume, expected.volume)


_HASHES = """
import hashlib, json, sys
import numpy as np
from tomo import solvers
from tomo.grid.voxel_grid import VoxelGrid
from tomo.operators.stored import Projector
from tomo.trace.segments import Segments
data = np.load(sys.argv[1])
segments = Segments(data["ptr"], data["voxel"], data["length"])
projector = Projector(segments, VoxelGrid(data["shape"], 1.0), data["view_ptr"])
for name, more in json.loads(sys.argv[2]):
    found = getattr(solvers, name)(projector, data["measured"], iterations=8, **more)
    residuals = [line.relative_residual for line in found.history]
    print(name, hashlib.sha256(found.volume.tobytes() + repr(residuals).encode()).hexdigest())
"""


def test_results_are_the_same_bits_on_one_thread_and_on_two(supersampled, tmp_path):
    # Large enough for BLAS to split its sums (10 000 elements), were any left to BLAS
    projector, s = supersampled.projector, supersampled.projector.segments
    ptr = np.concatenate([s.ptr[:-1] + k * len(s) for k in range(6)] + [[6 * len(s)]])
    np.savez(
        tmp_path / "system.npz",
        ptr=ptr,
        voxel=np.tile(s.voxel, 6),
        length=np.tile(s.length, 6),
        shape=projector.grid.shape,
        view_ptr=np.arange(6 * 9 + 1) * 320,
        measured=np.concatenate([_noisy(supersampled, seed=k) for k in range(6)]),
    )
    runs = []
    for threads in ("1", "2", "2"):
        names = ("NUMBA_NUM_THREADS", "OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS")
        environment = os.environ | dict.fromkeys(names, threads)
        command = [sys.executable, "-c", _HASHES, str(tmp_path / "system.npz"), json.dumps(CASES)]
        done = subprocess.run(command, env=environment, capture_output=True, text=True, check=True)
        runs.append(done.stdout.splitlines())
    assert len(runs[0]) == len(CASES)
    assert runs[0] == runs[1] == runs[2]
