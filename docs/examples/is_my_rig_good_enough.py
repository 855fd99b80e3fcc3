"""
Is my rig good enough?
======================

Eight cameras on one side of the flame, or all around: does it matter? Ask before you measure:
the check says which details a rig measures in every direction. A layer that no camera sees edge-on
is not measured, however many cameras there are. The volumes beside it show what that means.

:doc:`/guide/your_cameras` has the command ``check-rig``, :doc:`/theory/uncertainty` the formula.
"""

import matplotlib.pyplot as plt
import numpy as np

import phantoms
import rigs
import tomo

grid = tomo.VoxelGrid(shape=(32, 20, 32), spacing=1.0)  # mm
flame = phantoms.create("turbulent", extent=grid.extent, seed=1)
angles = np.radians(np.arange(0, 361, 2))
level = np.stack([np.sin(angles), 0 * angles, np.cos(angles)], axis=1)  # unit vectors
quick = tomo.Options(method="curvature", uncertainty=0, screen=False, refine_cameras="none")

figure = plt.figure(figsize=(8, 8), layout="constrained")
for row, (name, step) in enumerate((("within 40 degrees", 40 / 7), ("over a half circle", 22.5))):
    rig = rigs.ring(8, step, distance=500, image_size=(64, 44), footprint=0.6)
    check = rigs.check_rig(rig, grid)
    print(f"8 cameras {name}: {check.resolved.words('mm')}")
    finest = np.median(check.views_of_volume.wavelengths(level), axis=0)  # over the points
    scan = tomo.simulate(rig, flame, grid, supersample=2, refine=2, noise=0.02)
    result = tomo.reconstruct(scan, options=quick)

    axes = figure.add_subplot(2, 2, 2 * row + 1, projection="polar")
    axes.set(theta_zero_location="N", theta_direction=-1, rlim=(0, 32), rlabel_position=200)
    axes.fill_between(angles, np.minimum(finest, 32), color="#c8511b", alpha=0.35)
    bearings = [np.arctan2(camera.position[0], camera.position[2]) for camera in rig]
    axes.plot(bearings, [30] * 8, "v", color="#1b6fb0")
    axes.set_title(f"8 cameras (triangles) {name}:\nfinest detail, by direction (mm)")
    axes = figure.add_subplot(2, 2, 2 * row + 2)
    extent = (grid.lower[0], grid.upper[0], grid.lower[2], grid.upper[2])
    how, truth = {"origin": "lower", "extent": extent}, scan.truth[:, 10].T
    axes.imshow(result.volume[:, 10].T, "inferno", vmin=0, vmax=truth.max(), **how)
    axes.contour(truth, [0.3 * truth.max()], colors="w", linewidths=1, **how)
    error = result.report()["quality"]["nrmse"]
    axes.set(title=f"volume, {error:.0%} error (white: truth)", xlabel="x (mm)", ylabel="z (mm)")
figure.suptitle("Where orange reaches the rim, the rig is blind", weight="bold")
plt.show()
