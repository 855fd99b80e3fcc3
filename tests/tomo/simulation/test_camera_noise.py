import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tomo.simulation import camera_noise

SIZE = 400


@pytest.fixture
def ramp():
    """An image from 0 to 5, float64."""
    return np.linspace(0, 5, SIZE * SIZE).reshape(SIZE, SIZE)


def rng(seed=0):
    return np.random.default_rng(seed)


def test_gaussian_has_the_sigma_asked_for_in_every_pixel(ramp):
    error = camera_noise.gaussian(ramp, 0.1, rng()) - ramp
    n, sigma = error.size, 0.5
    assert abs(error.mean()) < 5 * sigma / np.sqrt(n)
    assert error.std() == pytest.approx(sigma, rel=5 / np.sqrt(2 * n))
    assert error[:40].std() == pytest.approx(error[-40:].std(), rel=0.03)  # dark and bright
    assert abs(np.corrcoef(error[:, 1:].ravel(), error[:, :-1].ravel())[0, 1]) < 5 / np.sqrt(n)
    assert abs((error**3).mean() / sigma**3) < 5 * np.sqrt(15 / n)
    assert (error**4).mean() / sigma**4 == pytest.approx(3, abs=5 * np.sqrt(96 / n))


def test_gaussian_takes_the_maximum_over_all_images():
    dim, bright = np.zeros((SIZE, SIZE)), np.full((30, 20), 8.0)
    noisy, _ = camera_noise.gaussian([dim, bright], 0.25, rng())
    assert noisy.std() == pytest.approx(2, rel=0.02)


@pytest.mark.parametrize("read_noise", [0.0, 7.0])
def test_poisson_has_the_mean_and_variance_of_counting(read_noise):
    photons, maximum = 500.0, 2.0
    gain = photons / maximum
    level = np.repeat([0.0, 0.1, 1.0, 2.0], 50_000).reshape(4, -1)
    found = camera_noise.poisson(level, photons, read_noise, rng(3))
    n = level.shape[1]
    expected = level[:, 0] / gain + (read_noise / gain) ** 2
    assert (np.abs(found.mean(axis=1) - level[:, 0]) <= 5 * np.sqrt(expected / n)).all()
    # Kurtosis of a Poisson variable adds 1 / mean to the relative variance 2 / n.
    np.testing.assert_allclose(found.var(axis=1), expected, rtol=5 * np.sqrt(2.1 / n))


RANDOM = [
    lambda images, generator: camera_noise.gaussian(images, 0.1, generator),
    lambda images, generator: camera_noise.poisson(images, 1000, 3, generator),
]


@pytest.mark.parametrize("apply", RANDOM)
def test_equal_seeds_give_equal_bits(apply, ramp):
    np.testing.assert_array_equal(apply(ramp, rng(4)), apply(ramp, rng(4)))
    assert (apply(ramp, rng(4)) != apply(ramp, rng(5))).mean() > 0.9


@pytest.mark.parametrize("apply", RANDOM)
def test_a_stack_gets_the_same_as_the_list_of_its_images(apply, ramp):
    stack = np.stack([ramp, 2 * ramp, ramp[::-1]])
    np.testing.assert_array_equal(apply(stack, rng(6)), np.stack(apply(list(stack), rng(6))))


@pytest.mark.parametrize("apply", RANDOM)
def test_inputs_stay_as_they_are_and_types_are_kept(apply):
    images = [np.full((4, 5), 3, np.float32), np.full((2, 3), 7, np.uint16), np.ones((2, 2))]
    copies = [image.copy() for image in images]
    found = apply(images, rng())
    assert isinstance(found, list)
    assert [f.dtype for f in found] == [np.float32, np.float32, np.float64]
    assert [f.shape for f in found] == [(4, 5), (2, 3), (2, 2)]
    for image, copy in zip(images, copies, strict=True):
        np.testing.assert_array_equal(image, copy)


@given(bits=st.integers(1, 16), full_scale=st.floats(1e-3, 1e6), seed=st.integers(0, 99))
@settings(max_examples=60, deadline=None)
def test_quantisation_loses_at_most_half_a_step(bits, full_scale, seed):
    image = full_scale * rng(seed).random((7, 8))
    integers = camera_noise.quantise(image, bits, full_scale)
    assert integers.dtype == (np.uint8 if bits <= 8 else np.uint16)
    assert integers.max() <= 2**bits - 1
    step = full_scale / (2**bits - 1)
    error = np.abs(integers * step - image)
    assert error.max() <= 0.5 * step * (1 + 1e-9)
    again = camera_noise.dequantise(integers, bits, full_scale)
    np.testing.assert_allclose(again, integers * step, rtol=1e-6)
    np.testing.assert_array_equal(camera_noise.quantise(again, bits, full_scale), integers)


def test_quantisation_uses_every_level_and_clips():
    image = np.linspace(-1, 5, 200_000)
    integers = camera_noise.quantise(image, 12, 4.0)
    np.testing.assert_array_equal(np.unique(integers), np.arange(4096))
    assert (integers[image < 0] == 0).all()
    assert (integers[image > 4] == 4095).all()


@pytest.mark.parametrize(
    ("call", "words"),
    [
        (lambda i: camera_noise.poisson(-i, 10, 1, rng()), "negative value, -1"),
        (lambda i: camera_noise.poisson(0 * i, 10, 1, rng()), "only zeros"),
        (lambda i: camera_noise.quantise(i, 17, 1.0), "bits: found 17"),
        (lambda i: camera_noise.quantise(i, 0, 1.0), "bits: found 0"),
        (lambda i: camera_noise.quantise(i, 8, 0.0), "full_scale: found 0"),
        (lambda i: camera_noise.dequantise([i, i * np.nan], 8, 1.0), "in image 1"),
        (lambda i: camera_noise.dequantise([], 8, 1.0), "found none"),
    ],
)
def test_says_what_is_wrong(call, words):
    with pytest.raises(ValueError, match=words) as caught:
        call(np.ones((3, 3)))
    assert "\n" not in str(caught.value)


def test_noise_beyond_single_precision_is_refused():
    image = np.ones((4, 5), np.float32)
    with pytest.raises(ValueError, match=r"noise: found .* overflow float32, expected less noise"):
        camera_noise.gaussian(image, 1e300, rng())
