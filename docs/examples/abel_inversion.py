"""
Abel inversion or tomography?
=============================

Our burner is round and we own one camera: is Abel inversion enough? For a flame that is round it is,
and it needs one image. For a flame that leans or burns brighter on one side it returns a round flame
all the same, and nothing in the result says so. A few more cameras see the difference.

Abel inversion is that of `PyAbel <https://pyabel.readthedocs.io>`_, which takes parallel rays: the
cameras here stand far away. One camera is not enough for tomography without symmetry, see
:doc:`/guide/limits`.
"""

import abel
import matplotlib.pyplot as plt
import numpy as np

import rigs
import tomo

grid = tomo.VoxelGrid(shape=(32, 12, 32), spacing=0.5)  # mm
how = {"distance": 5000, "image_size": (65, 30), "footprint": 0.25}
one, eight = rigs.ring(1, **how), rigs.ring(8, 22.5, **how)


def flame(lopsided, points):
    """Return a hollow cylinder of light; one side is brighter by this fraction."""
    x, _, z = np.moveaxis(points, -1, 0)
    radius = np.hypot(x, z)
    return np.exp(-(((radius - 4) / 1.2) ** 2)) * (1 + lopsided * x / np.maximum(radius, 0.1))
