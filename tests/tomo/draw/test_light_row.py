"""Light of several volumes beside each other: what is drawn is the line integral, in one scale."""

import matplotlib.pyplot as plt
import numpy as np
import pytest

import tomo
from tomo.draw import light_row

GRID = tomo.VoxelGrid((8, 12, 8), 0.5)


@pytest.fixture
def axes():
    figure, axes = plt.subplots(1, 2)
    yield axes
    plt.close(figure)


def test_a_level_view_has_the_lengths_of_chords_in_one_scale(axes):
    ones = np.ones(GRID.shape, np.float32)
    light_row(axes, {"whole": ones, "half": tomo.Volume(0.5 * ones, GRID)}, GRID, eye=(0, 0))
    whole, half = (panel.images[0].get_array() for panel in axes)
    rows, columns = whole.shape
    # the middle ray crosses 4 mm, six radii away within 1 %
    assert whole[rows // 2, columns // 2] == pytest.approx(4.0, rel=0.01)
    assert np.allclose(half, whole / 2, atol=1e-6)
    assert [panel.images[0].get_clim() for panel in axes] == [(0, 5)] * 2
    assert [panel.get_title() for panel in axes] == ["whole", "half"]


def test_the_scale_bar_is_as_long_as_it_says(axes):
    light_row(axes[:1], {"box": np.ones(GRID.shape)}, GRID, eye=(0, 0))
    (bar,), (text,) = axes[0].lines, axes[0].texts
    length, unit = text.get_text().split()
    rows = axes[0].images[0].get_array().max(axis=1) > 2  # box of 6 mm, from its dark surroundings
    assert unit == "mm"
    assert np.ptp(bar.get_xdata()) / float(length) == pytest.approx(rows.sum() / 6, rel=0.1)


@pytest.mark.parametrize(
    ("volumes", "named"),
    [({"one": np.ones(GRID.shape)}, "axes"), ({"a": np.ones((2, 2, 2)), "b": 0}, "volume")],
)
def test_what_does_not_fit_is_named(axes, volumes, named):
    with pytest.raises(ValueError, match=named):
        light_row(axes, volumes, GRID)
