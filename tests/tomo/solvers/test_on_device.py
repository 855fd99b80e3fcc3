"""Solvers on a device: arrays of torch and of the standard alone, on the host's build."""

import sys

import numpy as np
import pytest

import rigs
from tomo import solvers
from tomo.grid import ActiveVoxels, VoxelGrid
from tomo.operators import LinearSystem
from tomo.operators.gpu import on_device
from tomo.operators.gpu.device_operator import DeviceOperator
from tomo.priors import TotalVariation
from tomo.selection import choose_by_left_out_pixels, fits, solve_as_chosen, solve_several_smoothly
from tomo.selection.smooth_solve import smooth_start

GRID = VoxelGrid((9, 12, 10), (1.0, 1.2, 0.9), (3.0, -2.0, 1.0))
RIG = rigs.ring(
    5, distance=400.0, image_size=(24, 26), footprint=0.8, center=GRID.center, pitch_degrees=15.0
)
X, Y, Z = np.moveaxis(GRID.centers() - GRID.center, -1, 0)
TRUTH = np.exp(-((X / 2) ** 2) - (Y / 4) ** 2 - (Z / 2.5) ** 2).astype(np.float32)
SOME = ActiveVoxels.from_mask(
    GRID, (TRUTH > 0.05) | (np.random.default_rng(0).random(GRID.shape) < 0.3)
)
METHODS = [(name, {}) for name, row in solvers.METHODS.items() if row.any_basis]
WEIGHTED = ("cgls", "curvature", "l1", "sirt", "tikhonov", "tv")
MORE = [
    ("cgls", {"strength": 0.01}),
    ("mlem", {"subsets": 3}),
    ("sirt", {"subsets": 3}),
    *((name, {"weights": True, "nonnegative": False}) for name in WEIGHTED),
]
NEAR = 1e-5  # of the peak


class Copies:
    """Arrays that were copied to the device and from it, by how many values they have."""

    def __init__(self, library, monkeypatch):
        self.library, self.sizes = library, []
        compat = pytest.importorskip("array_api_compat")
        namespace = compat.array_namespace(library.asarray([0.0]))
        made, read = namespace.asarray, np.from_dlpack

        def asarray(values, **how):
            self.sizes += [values.size] if isinstance(values, np.ndarray) else []
            return made(values, **how)

        def from_dlpack(values, **how):
            self.sizes += [] if isinstance(values, np.ndarray) else [int(np.prod(values.shape))]
            return read(values, **how)

        def array(operator, values):
            return values if operator.takes(values) else asarray(np.array(values))

        def on_numpy(operator, apply, values):
            self.sizes += [values.size]
            return product(operator, apply, values)

        product = DeviceOperator._on_numpy
        monkeypatch.setattr(namespace, "asarray", asarray)
        monkeypatch.setattr(np, "from_dlpack", from_dlpack)
        monkeypatch.setattr(DeviceOperator, "array", array)
        monkeypatch.setattr(DeviceOperator, "_on_numpy", on_numpy)

    def large(self, least):
        """Return how many arrays of at least so many values were copied since the last call."""
        found, self.sizes = sum(size >= least for size in self.sizes), []
        return found


@pytest.fixture(scope="module", params=["torch", "array_api_strict"])
def library(request):
    return pytest.importorskip(request.param)


@pytest.fixture
def copies(library, monkeypatch):
    return Copies(library, monkeypatch)


@pytest.fixture(scope="module")
def own(library):
    """Return an operator on the CPU, in the linear basis: stored, of some voxels; or neither."""
    form, active = ("stored", SOME) if library.__name__ == "torch" else ("on-the-fly", None)
    return LinearSystem.from_rig(RIG, GRID, form=form, active=active).with_linear_basis().projector


def images_of(operator, noise=0.02):
    clear = operator @ operator.active.compress(TRUTH)
    return (clear + noise * clear.max() * np.random.default_rng(1).normal(size=len(clear))).astype(
        np.float32
    )


def near(found, expected):
    return np.abs(found - expected).max() <= NEAR * np.abs(expected).max()


@pytest.mark.parametrize(("method", "settings"), METHODS + MORE)
def test_a_solver_finds_the_cpus_volume_in_the_same_bits_and_copies_no_more(
    own, host, copies, method, settings
):
    there, _ = on_device(own, host)
    measured, settings = images_of(own), dict(settings)
    if settings.get("weights"):
        settings["weights"] = np.random.default_rng(2).uniform(0.2, 1, len(measured))
    solver = getattr(solvers, method)
    expected = solver(own, measured, iterations=6, **settings)
    seen, large = [], []

    def watch(index, volume, residual):
        seen.append(type(volume).__module__.partition(".")[0])
        large.append(copies.large(min(own.shape) // 4))

    found = solver(there, measured, iterations=6, callback=watch, **settings)
    assert set(seen) == {copies.library.__name__}
    assert sum(large[2:]) == 0  # the first update prepares
    assert isinstance(found.volume, np.ndarray)
    assert near(found.volume, expected.volume)
    assert found.relative_residual == pytest.approx(expected.relative_residual, rel=1e-4)
    again = solver(there, measured, iterations=6, **settings)
    assert np.array_equal(found.volume, again.volume)


@pytest.mark.parametrize("method", ["mlem", "curvature"])
def test_arrays_of_the_callers_library_are_taken_as_they_are(own, host, copies, method):
    there, _ = on_device(own, host)
    measured = images_of(own)
    start = np.full(own.shape[1], 0.5, np.float32)
    expected = getattr(solvers, method)(own, measured, start=start, iterations=4)
    given = (copies.library.asarray(one) for one in (measured, start))
    images, first = given
    found = getattr(solvers, method)(there, images, start=first, iterations=4)
    assert near(found.volume, expected.volume)
    wrong = copies.library.asarray(np.where(np.arange(len(measured)) == 3, np.nan, measured))
    with pytest.raises(ValueError, match="measured: found 1 NaN or infinite pixels"):
        getattr(solvers, method)(there, wrong)


def test_a_proximal_prior_goes_with_the_likelihood(own, host, copies):
    there, _ = on_device(own, host)
    how = {"prior": TotalVariation(own.active), "strength": 0.02, "iterations": 4}
    expected = solvers.mlem(own, images_of(own), **how)
    assert near(solvers.mlem(there, images_of(own), **how).volume, expected.volume)


def test_methods_that_go_through_rows_say_what_to_use(own, host):
    there, _ = on_device(own.without_blur, host)
    for method in ("art", "mart"):
        with pytest.raises(ValueError, match=f"{method} goes through stored rows on the CPU: use"):
            getattr(solvers, method)(there, images_of(own))


@pytest.mark.usefixtures("quick_choice")
def test_the_default_chooses_and_solves_as_on_the_cpu(own, host, copies, monkeypatch):
    monkeypatch.setattr(fits, "CHECKPOINTS", (3, 6))
    there, _ = on_device(own, host)
    measured = images_of(own)
    weights = np.random.default_rng(2).uniform(0.2, 1, len(measured)).astype(np.float32)
    expected = choose_by_left_out_pixels(own, measured, weights=weights)
    choice = choose_by_left_out_pixels(there, measured, weights=weights)
    assert choice.setting[:2] == expected.setting[:2]
    assert choice.held_out_residual == pytest.approx(expected.held_out_residual, rel=1e-4)
    volume = solve_as_chosen(own, measured, expected, weights=weights).volume
    found = solve_as_chosen(there, measured, expected, weights=weights).volume
    assert near(found, volume)
    again = solve_as_chosen(there, measured, expected, weights=weights).volume
    assert np.array_equal(again, found)


@pytest.mark.parametrize(("width", "strength"), [(0.0, 0.0), (0.0, 1e-3), (1.0, 1e-3)])
def test_several_frames_are_solved_at_once(own, host, copies, width, strength):
    there, _ = on_device(own, host)
    measured = images_of(own)
    film = np.stack([measured, measured[::-1], np.zeros_like(measured)], axis=1)
    weights = np.random.default_rng(2).uniform(0.2, 1, film.shape).astype(np.float32)
    how = {"width": width, "strength": strength, "iterations": 6, "weights": weights}
    expected = solve_several_smoothly(own, film, start=smooth_start(own, film), **how)
    found = solve_several_smoothly(there, film, start=smooth_start(there, film), **how)
    assert isinstance(found, np.ndarray)
    for column in range(3):
        assert near(found[:, column], expected[:, column])


def test_torch_without_the_standards_names_says_what_to_install(own, host, monkeypatch):
    torch = pytest.importorskip("torch")
    monkeypatch.setitem(sys.modules, "array_api_compat", None)
    there, _ = on_device(own, host)
    with pytest.raises(ValueError, match=r"found no array-api-compat, .* 'flametomo\[gpu\]'"):
        solvers.mlem(there, torch.from_numpy(images_of(own)))
