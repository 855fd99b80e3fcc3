import numpy as np

from tomo.grid import VoxelGrid
from tomo.view.volume_picture import line_integrals, middle_planes

GRID = VoxelGrid((4, 7, 5), (0.5, 1.0, 2.0), (10.0, 20.0, 30.0))


def test_planes_show_each_value_at_its_place():
    field = GRID.centers() @ [1.0, 100.0, 10_000.0]  # tells all three coordinates apart
    for values, (level, upright, across), extent, at in middle_planes(field, GRID):
        rows, columns = GRID.shape[upright], GRID.shape[level]
        assert values.shape == (rows, columns)
        assert at == GRID.center[across]
        weights = [1.0, 100.0, 10_000.0]
        x = extent[0] + (np.arange(columns) + 0.5) * (extent[1] - extent[0]) / columns
        y = extent[2] + (np.arange(rows) + 0.5) * (extent[3] - extent[2]) / rows
        expected = x[None] * weights[level] + y[:, None] * weights[upright] + at * weights[across]
        np.testing.assert_allclose(values, expected)


def test_line_integrals_keep_the_total_emission():
    data = np.random.default_rng(0).random(GRID.shape)
    total = data.sum() * np.prod(GRID.spacing)
    for values, (level, upright, _), _, _ in line_integrals(data, GRID):
        area = GRID.spacing[level] * GRID.spacing[upright]
        np.testing.assert_allclose(values.sum() * area, total)
