"""Whole numbers no wider than what they count."""

import numpy as np
import pytest

from tomo._compute.grouping import index_type


@pytest.mark.parametrize("count", [0, 1, 2**31 - 1, 2**31, 2**40])
def test_the_last_of_them_and_none_have_a_number(count):
    kind = index_type(count)
    assert kind == (np.int32 if count < 2**31 else np.int64)
    for number in (-1, max(count - 1, 0)):
        assert np.array(number).astype(kind) == number
