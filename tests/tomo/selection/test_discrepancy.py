import numpy as np
import pytest

from tomo import metrics, solvers
from tomo.selection.discrepancy import noise_residual, stop_at_noise, strength_at_noise


@pytest.fixture(scope="module")
def noisy(ring_system):
    noise = 0.05 * ring_system.measured.max()
    random = np.random.default_rng(0)
    seen = ring_system.measured + noise * random.standard_normal(len(ring_system.measured))
    return ring_system.projector, ring_system.truth, seen.astype(np.float32), noise


def test_the_level_is_the_residual_of_the_truth(noisy, ring_system):
    projector, _, measured, noise = noisy
    true = np.linalg.norm(measured - ring_system.measured) / np.linalg.norm(measured)
    assert noise_residual(projector, measured, noise) == pytest.approx(true, rel=0.05)
    each = np.full(len(measured), noise)
    assert noise_residual(projector, measured, each) == noise_residual(projector, measured, noise)
    weights = np.where(np.arange(len(measured)) % 2, 4.0, 0.0)
    half = noise_residual(projector, measured, noise, weights)
    expected = noise * np.sqrt(len(measured) / 2) / np.linalg.norm(measured[1::2])
    assert half == pytest.approx(expected, rel=1e-6)
    assert np.isnan(noise_residual(projector, np.zeros(len(measured)), noise))


@pytest.mark.parametrize("bad", [-1.0, np.nan, np.inf])
def test_noise_must_be_a_standard_deviation(noisy, bad):
    projector, _, measured, _ = noisy
    with pytest.raises(ValueError, match="noise: found negative, NaN or infinite"):
        noise_residual(projector, measured, bad)
    with pytest.raises(ValueError, match="noise: found shape"):
        noise_residual(projector, measured, [1.0, 2.0])


@pytest.mark.parametrize("method", ["cgls", "nnls", "sirt"])
def test_stopping_at_the_noise_is_better_than_going_on(noisy, method):
    projector, truth, measured, noise = noisy
    seen = []
    callback = stop_at_noise(
        1.02 * noise_residual(projector, measured, noise), lambda index, *_: seen.append(index)
    )
    solver = getattr(solvers, method)
    found = solver(projector, measured, iterations=400, callback=callback)
    assert found.stop_reason.startswith("stopped by the callback")
    assert seen == list(range(len(found.history)))
    on = solver(projector, measured, iterations=400)
    stopped = metrics.cosine_distance(found.volume, truth)
    assert stopped < 0.5 * metrics.cosine_distance(on.volume, truth)


def test_another_callback_may_stop_first(noisy):
    projector, _, measured, _ = noisy
    callback = stop_at_noise(0.0, lambda index, *_: index == 2)
    found = solvers.sirt(projector, measured, iterations=9, callback=callback)
    assert found.stop_reason == "stopped by the callback at iteration 2"


@pytest.mark.parametrize("method", ["tv", "tikhonov"])
@pytest.mark.parametrize("first", [1e-6, 1e-3, 1.0])
def test_the_strength_found_fits_as_well_as_the_noise_allows(noisy, method, first):
    projector, truth, measured, noise = noisy
    solver = getattr(solvers, method)
    found = strength_at_noise(
        solver, projector, measured, noise, first=first, runs=12, iterations=40
    )
    level = noise_residual(projector, measured, noise)
    assert found.relative_residual == pytest.approx(level, rel=3e-3)
    weak = solver(projector, measured, strength=found.settings["strength"] / 100, iterations=40)
    strong = solver(projector, measured, strength=found.settings["strength"] * 30, iterations=40)
    distance = metrics.cosine_distance(found.volume, truth)
    assert distance < 0.6 * metrics.cosine_distance(weak.volume, truth)
    assert distance < 0.6 * metrics.cosine_distance(strong.volume, truth)


def test_a_level_that_no_strength_reaches_ends_the_search(noisy):
    projector, _, measured, noise = noisy
    strengths = []

    def counted(*arguments, **settings):
        strengths.append(settings["strength"])
        return solvers.tv(*arguments, **settings)

    found = strength_at_noise(counted, projector, measured, noise / 5, runs=20, iterations=40)
    assert len(strengths) < 12
    assert found.settings["strength"] == strengths[-2]
    assert found.relative_residual > 2 * noise_residual(projector, measured, noise / 5)
    loose = strength_at_noise(
        solvers.tv, projector, measured, noise / 5, factor=5, runs=12, iterations=40
    )
    level = noise_residual(projector, measured, noise)
    assert loose.relative_residual == pytest.approx(level, rel=3e-3)


def test_dark_images_need_no_search(noisy):
    projector, _, measured, noise = noisy
    found = strength_at_noise(solvers.tv, projector, np.zeros_like(measured), noise, iterations=2)
    np.testing.assert_array_equal(found.volume, 0)


@pytest.mark.parametrize("bad", [{"first": 0.0}, {"first": np.nan}, {"runs": 0}])
def test_a_search_must_begin_somewhere(noisy, bad):
    projector, _, measured, noise = noisy
    with pytest.raises(ValueError, match="first, runs: found"):
        strength_at_noise(solvers.tv, projector, measured, noise, **bad)
