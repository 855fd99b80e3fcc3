"""The effect that the page on adding one writes is one."""

import re
from pathlib import Path

import numpy as np
import pytest

PAGE = Path(__file__).parents[3] / "docs/develop/adding_an_effect.md"


def test_the_column_of_the_pages_effect_is_its_derivative():
    printed = []
    names = {"print": lambda *numbers: printed.extend(numbers)}
    for block in re.findall(r"^```python\n(.*?)^```", PAGE.read_text("utf-8"), re.M | re.S):
        exec(compile(block, PAGE.name, "exec"), names)
    np.testing.assert_allclose(printed, 1, atol=1e-4)
    assert len(printed) == 2
    assert names["Slope"]().deviation(names["seen"]).shape == (3, 1)
    assert names["Slope"]().sigma == pytest.approx(0.005)
