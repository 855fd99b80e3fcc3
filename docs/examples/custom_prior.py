"""
Your own prior
==============

You know something of your flame that three cameras cannot see: where it cannot burn, how it
decays, which parts are alike. How does the solver learn of it? A prior is a small class with two
functions, ``D x`` and its transpose ``D^T p``. Solvers of the package then minimise ``||b - A
x||^2 + strength m ||D x||^2``.

The burner here has four equal nozzles, and ``D x`` is the difference between the volume and
itself turned by a quarter. Symmetry is not forced: one nozzle burns brighter, and the images
still show it. :doc:`/develop/adding_a_prior` has the scale ``m``, and priors that have a
proximal map in place of ``D``.
"""

import matplotlib.pyplot as plt
import numpy as np

import rigs
import tomo


def four_nozzles(points):
    """Return the emission of four cones of light on a square; one is 15 % brighter."""
    x, y, z = np.moveaxis(points, -1, 0)
    square = (np.abs(x) - 4) ** 2 + (np.abs(z) - 4) ** 2
    light = np.exp(-square / (2 - y / 12) ** 2 - (y / 9) ** 4)
    return light * np.where((x > 0) & (z > 0), 1.15, 1)


grid = tomo.VoxelGrid(shape=(20, 24, 20), spacing=1.0)  # mm
rig = rigs.ring(3, 55, distance=500, image_size=(48, 48), footprint=0.7, start_degrees=8)
scan = tomo.simulate(rig, four_nozzles, grid, supersample=2, refine=2, noise=0.02, seed=1)
system = tomo.LinearSystem.from_rig(rig, grid)
A, measured = system.projector, system.flatten(scan.images())


class QuarterTurn:
    """``||x - x turned by 90 degrees about y||^2``."""

    def forward(self, x):
        return x - np.rot90(x.reshape(grid.shape), axes=(0, 2)).ravel()

    def adjoint(self, p):
        return p - np.rot90(p.reshape(grid.shape), -1, axes=(0, 2)).ravel()


solver, how = tomo.solvers.projected_cg, {"prior": QuarterTurn(), "strength": 0.01}
volumes = {
    "truth": scan.truth,
    "no prior": solver(A, measured, iterations=20).volume,
    "your prior": solver(A, measured, iterations=60, **how).volume,
}
figure, axes = plt.subplots(2, 3, figsize=(10, 7), layout="constrained")
tomo.draw.light_row(axes[0], volumes, grid, eye=(28, 40))
for ax, (name, volume) in zip(axes[1], volumes.items(), strict=True):
    error, bright = tomo.metrics.nrmse(volume, scan.truth), volume[10:, :, 10:].sum()
    print(f"{name}: error {error:.0%}; bright nozzle {4 * bright / volume.sum():.2f} of the mean")
    cut = volume[:, 12].T  # y = 0.5 mm
    drawn = ax.imshow(cut, "inferno", extent=(-10, 10, -10, 10), origin="lower", vmin=0, vmax=1.2)
    ax.set(title="plane y = 0.5 mm", xlabel="x (mm)", ylabel="z (mm)")
figure.colorbar(drawn, ax=axes[1], label="emission", shrink=0.8)
plt.show()
