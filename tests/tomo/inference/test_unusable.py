"""Images that say nothing are known from those that show little."""

import numpy as np
import pytest

from tomo.inference.misplaced import doubles, is_dark
from tomo.measurement import NoiseModel

SIZE = (48, 36)
ALL = np.ones(SIZE, bool)
NOISE = NoiseModel(1.0)


def noise_of(seed, size=SIZE):
    return np.random.default_rng(seed).normal(10, 1, size).astype(np.float32)


def test_one_value_all_over_is_dark():
    for value in (0.0, 7.0):
        assert is_dark(np.full(SIZE, value, np.float32), ALL, NoiseModel(0.0))
    assert is_dark(noise_of(0), np.zeros(SIZE, bool), NOISE)


@pytest.mark.parametrize("seed", range(8))
def test_noise_alone_is_dark(seed):
    image = noise_of(seed, (400, 300))  # of its 7500 blocks one is brighter by 3.7 deviations
    assert is_dark(image, np.ones(image.shape, bool), NOISE)


@pytest.mark.parametrize("seed", range(5))
def test_a_faint_spark_and_a_faint_haze_are_light(seed):
    spark, haze = noise_of(seed), noise_of(seed)
    spark[20:24, 12:16] += 2.5
    haze[10:26, 5:21] += 1.5
    assert not is_dark(spark, ALL, NOISE)
    assert not is_dark(haze, ALL, NOISE)
    off = ALL.copy()
    off[20:24, 12:16] = False
    assert is_dark(spark, off, NOISE)


def test_images_that_are_the_same_are_doubles():
    one, other, dark = noise_of(0), noise_of(1), np.zeros(SIZE, np.float32)
    assert doubles([one, dark, other, one.copy(), dark, one]) == [[0, 3, 5]]
    assert doubles([one, other, one[:-1]]) == []
