"""
From images to a first volume
=============================

How good is the volume that a dozen cameras give, and how would I know without the truth? Eleven
cameras make the volume, and the twelfth is held out: the volume predicts its image. On real
images, where no truth is known, this is the best check there is.

:doc:`/guide/first_volume` does the same with commands; :doc:`/guide/reading_the_report` says what
the figures mean.
"""

import matplotlib.pyplot as plt

import phantoms
import rigs
import tomo

grid = tomo.VoxelGrid(shape=(24, 36, 24), spacing=0.5)  # mm
rig = rigs.ring(12, distance=500, image_size=(48, 60), footprint=0.35, pitch_degrees=10)
flame = phantoms.create("turbulent", extent=grid.extent, seed=2)

# finer voxels and four rays a pixel: nothing inverts the simulation's own matrix
scan = tomo.simulate(rig, flame, grid, supersample=2, refine=2, noise=0.02, seed=1)
result = tomo.reconstruct(scan, options=tomo.Options(hold_out=("cam05",)))

report = result.report()
error, held_out = report["quality"]["nrmse"], report["held_out"]["cam05"]
print(f"error against the truth {error:.1%} (NRMSE), chosen method {report['method']}")
print(f"held-out camera: predicted to {held_out['psnr']:.1f} dB, SSIM {held_out['ssim']:.2f}")

figure, axes = plt.subplots(2, 3, figsize=(9, 9), layout="constrained")
(x0, y0, z0), (x1, y1, z1) = grid.lower, grid.upper
how = {"cmap": "inferno", "origin": "lower", "vmin": 0, "vmax": scan.truth.max()}
for row, name, volume in zip(axes, ("truth", "volume"), (scan.truth, result.volume), strict=True):
    row[0].imshow(volume[:, :, 12].T, extent=(x0, x1, y0, y1), **how)
    row[0].set(title=f"{name}, plane z = 0", xlabel="x (mm)", ylabel="y (mm)")
    shown = row[1].imshow(volume[12], extent=(z0, z1, y0, y1), **how)
    row[1].set(title=f"{name}, plane x = 0", xlabel="z (mm)")
figure.colorbar(shown, ax=axes[:, :2], label="emission", location="bottom", shrink=0.6)
view = result.views[5]
axes[0, 2].imshow(view.measured, "inferno", vmin=0, vmax=view.measured.max())
axes[0, 2].set(title="cam05, held out: measured", ylabel="row (pixel)")
axes[1, 2].imshow(view.reprojected, "inferno", vmin=0, vmax=view.measured.max())
axes[1, 2].set(title="cam05: predicted", xlabel="column (pixel)")
title = f"The volume is {error:.0%} off, and predicts a camera it never saw to"
figure.suptitle(f"{title} {held_out['psnr']:.0f} dB", weight="bold")
plt.show()
