import numpy as np
import pytest
from scipy.ndimage import gaussian_filter

from tomo import VoxelGrid
from tomo.grid import ActiveVoxels
from tomo.uncertainty.bootstrap_calibration import Spread, calibrated

GRID = VoxelGrid((16, 20, 16), 1.0)
LIVE = ActiveVoxels(GRID)


@pytest.fixture
def random():
    return np.random.default_rng(2)


@pytest.fixture
def true(random):
    """Deviations that change slowly, over two powers of ten, and a mean that follows them."""
    rough = gaussian_filter(random.standard_normal(GRID.shape), 3.0).ravel()
    return 10 ** (rough / rough.std() / 2)


def spread(deviation):
    return Spread(deviation, 3 * deviation)


def error(found, true):
    return np.sqrt(np.mean(np.log(found / true) ** 2))


@pytest.mark.parametrize("wrong", [0.5, 2.0])
def test_what_a_bootstrap_gets_wrong_everywhere_is_corrected(true, wrong):
    found = calibrated(spread(wrong * true), spread(wrong**2 * true), LIVE)
    assert found == pytest.approx(true, rel=1e-3)


def test_a_bias_that_grows_towards_small_deviations_is_corrected(true):
    def biased(deviation):
        return deviation * (1 + 0.1 / np.maximum(deviation, 0.1))

    first = biased(true)
    found = calibrated(spread(first), spread(biased(first)), LIVE)
    assert error(found, true) < 0.4 * error(first, true)


def test_scatter_is_drawn_to_the_surroundings(true, random):
    def scattered(deviation):
        return deviation * np.exp(0.6 * random.standard_normal(len(deviation)))

    first = scattered(true)
    found = calibrated(spread(first), spread(scattered(first)), LIVE)
    assert error(found, true) < 0.85 * error(first, true)
    assert np.median(found / true) == pytest.approx(1, abs=0.1)


def test_where_nothing_is_wrong_nothing_changes(true):
    assert calibrated(spread(true), spread(true), LIVE) == pytest.approx(true, rel=1e-12)


def test_what_never_moved_stays_at_zero(true):
    still = np.zeros(GRID.shape, bool)
    still[:, 10:, :] = True
    first = np.where(still.ravel(), 0.0, true)
    found = calibrated(spread(first), spread(1.2 * first), LIVE).reshape(GRID.shape)
    assert not found[:, 15:, :].any()
    assert found[:, :10, :].min() > 0
    nothing = np.zeros(GRID.size)
    assert not calibrated(spread(nothing), spread(nothing), LIVE).any()


def test_the_unit_does_not_matter(true, random):
    first, second = (true * np.exp(0.5 * random.standard_normal(GRID.size)) for _ in range(2))
    found = calibrated(spread(first), spread(second), LIVE)
    large = calibrated(spread(1e6 * first), spread(1e6 * second), LIVE)
    assert large == pytest.approx(1e6 * found, rel=1e-9)


def test_voxels_that_are_no_unknowns_take_no_part(true, random):
    mask = np.zeros(GRID.shape, bool)
    mask[:, :10, :] = True
    active = ActiveVoxels.from_mask(GRID, mask)
    half = ActiveVoxels(VoxelGrid((16, 10, 16), 1.0))
    first, second = (true * np.exp(0.5 * random.standard_normal(GRID.size)) for _ in range(2))
    first, second = (spread(active.compress(deviation)) for deviation in (first, second))
    assert calibrated(first, second, active) == pytest.approx(calibrated(first, second, half))
