import itertools

import numpy as np
import pytest

from tomo.draw.emission import EYE, emission_image
from tomo.draw.frame import Up, Viewpoint
from tomo.draw.shapes import box_corners
from tomo.draw.volume.planes import middle_planes
from tomo.draw.volume.visualize import draw_volume
from tomo.grid import Volume, VoxelGrid

GRID = VoxelGrid((4, 7, 5), (0.5, 1.0, 2.0), (10.0, 20.0, 30.0))


def test_planes_show_each_value_at_its_place():
    field = GRID.centers() @ [1.0, 100.0, 10_000.0]  # tells all three coordinates apart
    for plane in middle_planes(Volume(field, GRID)):
        values, (level, upright, across) = plane.values, plane.axes
        extent, at = plane.extent, plane.at
        rows, columns = GRID.shape[upright], GRID.shape[level]
        assert values.shape == (rows, columns)
        assert at == GRID.center[across]
        weights = [1.0, 100.0, 10_000.0]
        x = extent[0] + (np.arange(columns) + 0.5) * (extent[1] - extent[0]) / columns
        y = extent[2] + (np.arange(rows) + 0.5) * (extent[3] - extent[2]) / rows
        expected = x[None] * weights[level] + y[:, None] * weights[upright] + at * weights[across]
        np.testing.assert_allclose(values, expected)


def parts(figure):
    """Return the axes of the planes, and those of their colour bar."""
    planes = [axes for axes in figure.axes if axes.axison and axes.get_images()]
    return planes, [axes for axes in figure.axes if axes.axison and not axes.get_images()]


def ticks_apart(axis):
    """Return the ticks in view of a plane's axis; they lie apart."""
    low, high = sorted(axis.get_view_interval())
    ticks = [tick for tick in axis.get_major_ticks() if low <= tick.get_loc() <= high]
    ticks = [tick for tick in ticks if tick.label1.get_visible()]
    boxes = [tick.label1.get_window_extent() for tick in ticks]
    assert boxes
    assert not any(a.overlaps(b) for a, b in itertools.pairwise(boxes))
    return ticks


@pytest.mark.parametrize("shape", [(40, 1, 40), (1, 44, 36), (40, 44, 1), (30, 140, 30)])
def test_words_and_scales_of_a_picture_can_be_read(shape):
    """What a plane is called is read against it or beside it; numbers lie apart.

    Every colour scale is long enough, and in the figure. Light across a thin volume reaches the
    upper part of its scale, and does not leave it.
    """
    grid = VoxelGrid(shape, 1.0)
    data = np.exp(-(grid.centers() ** 2).sum(axis=-1) / 80).astype(np.float32)
    figure = draw_volume(Volume(data, grid))
    figure.canvas.draw()
    (scale,) = figure.axes[0].child_axes
    low, high = scale.get_ylim()
    viewpoint = Viewpoint.framing(
        box_corners(grid.lower, grid.upper), Up().eye_direction(*EYE), (0, 1, 0), (200, 200)
    )
    brightest = emission_image(Volume(data, grid), viewpoint).max()
    assert low == 0
    assert 0.25 * high <= brightest <= 1.01 * high
    planes, (bar,) = parts(figure)
    assert len(planes) == 3
    box = bar.get_window_extent()
    assert box.height > 0.45 * figure.dpi
    assert box.y0 > 0
    inside = figure.bbox
    for axes in planes:
        name = axes.title.get_window_extent()
        assert not name.overlaps(axes.get_window_extent())
        assert inside.x0 < name.x0 < name.x1 < inside.x1
        ticks_apart(axes.xaxis)
        ticks_apart(axes.yaxis)
    names = [axes.title.get_window_extent() for axes in planes]
    assert not any(a.overlaps(b) for a, b in itertools.combinations(names, 2))


def test_emission_is_shown_from_zero():
    for data, ends in ((np.full(GRID.shape, 4.0), (0, 4)), (np.zeros(GRID.shape), (0, 1))):
        planes, _ = parts(draw_volume(Volume(data, GRID)))
        assert {axes.get_images()[0].get_clim() for axes in planes} == {ends}


def test_far_from_the_origin_coordinates_are_written_out():
    """No plane's numbers are differences from one that stands aside, or rounded beyond use."""
    grid = VoxelGrid((20, 24, 16), 1.0, (100_000.0, -300_000.0, 200_000.5))
    data = np.ones(grid.shape, np.float32)
    figure = draw_volume(Volume(data, grid))
    figure.canvas.draw()
    planes, _ = parts(figure)
    names = [axes.title.get_text() for axes in planes]
    assert names == ["z = 200000.5", "x = 100000", "y = -300000"]
    for axes in planes:
        for axis in (axes.xaxis, axes.yaxis):
            assert axis.get_offset_text().get_text() == ""
            for tick in ticks_apart(axis):
                text = tick.label1.get_text().replace("\N{MINUS SIGN}", "-")
                assert float(text) == tick.get_loc()
