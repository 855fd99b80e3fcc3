import numpy as np
import pytest

from tomo.grid import VoxelGrid
from tomo.projector import Projector
from tomo.rays import Rays
from tomo.trace import trace


@pytest.fixture(scope="session")
def lines():
    """Return the projector of 400 lines every which way, in four views, the second without any."""
    grid = VoxelGrid((9, 14, 7), (0.5, 0.4, 0.6), (0.3, -0.2, 0.1))
    rng = np.random.default_rng(0)
    directions = rng.standard_normal((400, 3))
    points = rng.uniform(grid.lower - 0.5, grid.upper + 0.5, (400, 3))
    segments = trace(Rays.from_lines(points - 20 * directions, directions), grid)
    return Projector(segments, grid, [0, 100, 100, 250, 400])
