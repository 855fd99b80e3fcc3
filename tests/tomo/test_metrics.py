import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from tomo import metrics

values = arrays(np.float64, 12, elements=st.floats(-100, 100).filter(lambda v: abs(v) > 1e-3))
BOTH = [
    metrics.cosine_distance,
    metrics.cosine_similarity,
    metrics.nrmse,
    metrics.relative_residual,
    metrics.psnr,
    metrics.ssim,
]


@given(a=values, b=values)
@settings(deadline=None)
def test_cosine_is_the_textbook_one(a, b):
    expected = a @ b / np.linalg.norm(a) / np.linalg.norm(b)
    assert metrics.cosine_similarity(a, b) == pytest.approx(expected, abs=1e-12)
    assert metrics.cosine_distance(a, b) == pytest.approx(1 - expected, abs=1e-12)
    assert 0 <= metrics.cosine_distance(a, b) <= 2 + 1e-12


@given(a=values, b=values, log_scale=st.floats(-200, 200))
@settings(deadline=None)
def test_cosine_ignores_positive_scale_and_order(a, b, log_scale):
    distance = metrics.cosine_distance(a, b)
    assert metrics.cosine_distance(10.0**log_scale * a, b) == pytest.approx(distance, abs=1e-12)
    assert metrics.cosine_distance(b, a) == pytest.approx(distance, abs=1e-14)
    assert metrics.cosine_distance(a, a) == 0
    assert metrics.cosine_distance(a, -a) == pytest.approx(2, abs=1e-12)


@pytest.mark.parametrize("angle", [1e-2, 1e-4, 3e-5, 1e-7])
def test_tiny_cosine_distances_keep_their_digits(angle):
    """At an angle t the distance is 1 - cos t = 2 sin²(t/2), here down to 5e-15."""
    a = np.array([math.cos(0.3), math.sin(0.3)])
    b = np.array([math.cos(0.3 + angle), math.sin(0.3 + angle)])
    exact = 2 * math.sin(angle / 2) ** 2
    assert metrics.cosine_distance(5 * a, 3 * b) == pytest.approx(exact, rel=1e-7)


def test_float32_volumes_are_compared_in_float64():
    a = np.random.default_rng(0).random((40, 40, 40)).astype(np.float32)
    b = a + np.float32(1e-4)
    a64, b64 = a.astype(np.float64), b.astype(np.float64)
    assert metrics.cosine_distance(b, a) == metrics.cosine_distance(b64, a64)
    assert metrics.nrmse(b, a) == metrics.nrmse(b64, a64)


def test_zeros():
    zero, one = np.zeros(3), np.ones(3)
    assert metrics.cosine_distance(zero, zero) == 0
    assert metrics.cosine_distance(zero, one) == metrics.cosine_distance(one, zero) == 1
    assert metrics.cosine_similarity(zero, one) == 0
    assert metrics.nrmse(zero, zero) == 0
    assert metrics.nrmse(one, zero) == math.inf
    assert metrics.nrmse(zero, one) == 1


@given(a=values, b=values, scale=st.floats(1e-3, 1e3))
@settings(deadline=None)
def test_nrmse_is_relative_to_the_rms_of_the_truth(a, b, scale):
    expected = math.sqrt(((a - b) ** 2).mean() / (b**2).mean())
    assert metrics.nrmse(a, b) == pytest.approx(expected, abs=1e-12)
    assert metrics.nrmse(scale * a, scale * b) == pytest.approx(expected, rel=1e-9, abs=1e-12)
    padded = [np.concatenate([v, np.zeros(30)]) for v in (a, b)]
    assert metrics.nrmse(*padded) == pytest.approx(expected, rel=1e-9, abs=1e-12)
    assert metrics.relative_residual(a, b) == metrics.nrmse(a, b)


def test_psnr_of_a_known_error():
    truth = np.linspace(0, 1, 100).reshape(10, 10)
    assert metrics.psnr(truth + 0.1, truth) == pytest.approx(20)
    assert metrics.psnr(truth + 0.01, truth, data_range=1.0) == pytest.approx(40)
    assert metrics.psnr(truth + 0.1, truth, data_range=10.0) == pytest.approx(40)
    assert metrics.psnr(truth, truth) == math.inf


def test_ssim_is_one_for_equals_and_falls_with_noise():
    rng = np.random.default_rng(1)
    for shape in ((40, 50), (12, 14, 16)):
        truth = np.add.outer(*[np.linspace(0, 1, n) for n in shape[:2]])
        truth = np.broadcast_to(truth.reshape(truth.shape + (1,) * (len(shape) - 2)), shape)
        noise = rng.normal(size=shape)
        found = [metrics.ssim(truth + s * noise, truth, data_range=2) for s in (0, 0.01, 0.1, 1)]
        assert found[0] == pytest.approx(1, abs=1e-12)
        assert found == sorted(found, reverse=True)
        assert found[-1] < 0.2


def test_ssim_depends_on_the_range():
    truth = np.random.default_rng(2).random((20, 20))
    other = truth[::-1]
    assert metrics.ssim(other, truth, data_range=100) > metrics.ssim(other, truth, data_range=1)


@pytest.mark.parametrize("metric", BOTH)
def test_shapes_must_agree(metric):
    with pytest.raises(ValueError, match=r"\(8, 9\) and \(9, 8\)"):
        metric(np.ones((8, 9)), np.ones((9, 8)))
    with pytest.raises(ValueError, match="at least one"):
        metric(np.ones((0, 9)), np.ones((0, 9)))


@pytest.mark.parametrize("metric", [metrics.psnr, metrics.ssim])
def test_a_range_must_be_positive(metric):
    flat = np.ones((10, 10))
    with pytest.raises(ValueError, match="data_range: found 0"):
        metric(flat, flat)
    with pytest.raises(ValueError, match="data_range: found nan"):
        metric(flat, flat, data_range=math.nan)


def test_ssim_needs_a_window():
    with pytest.raises(ValueError, match=r"ssim: found shape \(6, 30\)"):
        metrics.ssim(np.ones((6, 30)), np.ones((6, 30)), data_range=1)


def test_nan_is_not_hidden():
    bad = np.array([1.0, np.nan])
    assert math.isnan(metrics.cosine_distance(bad, np.ones(2)))
    assert math.isnan(metrics.nrmse(bad, np.ones(2)))
