"""
Where can the volume be trusted?
================================

No truth is known in a laboratory: which parts of the volume are sure, and which are guessed?
Every voxel gets the half-width of an interval that holds the truth in nine of ten voxels. It
comes from the images alone: from leaving cameras out, from solving once more, and from what the
volume leaves unexplained.

This flame is simulated, so that intervals and errors can be compared. The half-widths show where
the errors are, not their signs. :doc:`/theory/uncertainty` has the formulas, and
:doc:`/guide/reading_the_report` says what the report makes of them.
"""

import matplotlib.pyplot as plt
import numpy as np

import phantoms
import rigs
import tomo

grid = tomo.VoxelGrid(shape=(24, 40, 24), spacing=1.0)  # mm
flame = phantoms.create("turbulent", extent=grid.extent, seed=4)
rig = rigs.ring(10, 35, distance=500, image_size=(60, 84), footprint=0.6, pitch_degrees=8)
scan = tomo.simulate(rig, flame, grid, supersample=2, refine=2, noise=0.02, seed=1)

result = tomo.reconstruct(scan)
volume, half_width = result.volume, result.uncertainty.half_width
error = np.abs(volume - scan.truth)

emitting = volume > 0.01 * volume.max()
covered = np.mean(error[emitting] <= half_width[emitting])
print(f"{emitting.sum()} emitting voxels: {covered:.0%} of the intervals hold the truth")

# voxels in order of their half-widths, in ten groups of equal size
order = np.argsort(half_width[emitting])
predicted, true = (
    [np.quantile(part, 0.9) for part in np.array_split(of[emitting][order], 10)]
    for of in (half_width, error)
)

figure, axes = plt.subplot_mosaic("abcd;eeee", figsize=(10, 8.5), layout="constrained")
tomo.draw.light_row([axes[key] for key in "ab"], {"truth": scan.truth, "volume": result}, grid)
most = np.quantile(error[:, :, 12], 0.995)
for key, values, title in (("c", half_width, "predicted half-width"), ("d", error, "true error")):
    how = {"extent": (-12, 12, -20, 20), "origin": "lower", "vmin": 0, "vmax": most}
    drawn = axes[key].imshow(values[:, :, 12].T, "viridis", **how)
    axes[key].set(title=title, xlabel="x (mm)", ylabel="y (mm)")
figure.colorbar(drawn, ax=[axes["c"], axes["d"]], label="emission, z = 0.5 mm", shrink=0.8)
axes["e"].plot([0, most], [0, most], "0.6", label="as predicted")
axes["e"].plot(predicted, true, "C1o-", label="a tenth of the emitting voxels each")
axes["e"].set(xlabel="half-width of the 90 % interval", ylabel="nine of ten errors are below")
axes["e"].legend()
plt.show()
