"""
From images to a first volume
=============================

How good is the volume that a dozen cameras give, and how would I know without the truth? Eleven
cameras make the volume, and the twelfth is held out: the volume predicts its image. On real
images, where no truth is known, this is the best check there is.
The light of truth and volume stands above, as a camera beside the flame sees it.

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

figure, axes = plt.subplot_mosaic("ab;cd", figsize=(7.5, 9), layout="constrained")
tomo.draw.light_row([axes[key] for key in "ab"], {"truth": scan.truth, "volume": result}, grid)
view = result.views[5]
for key, image, title in (("c", view.measured, "measured"), ("d", view.reprojected, "predicted")):
    drawn = axes[key].imshow(image, "inferno", vmin=0, vmax=view.measured.max())
    axes[key].set(title=f"cam05, held out: {title}", xlabel="column (pixel)", ylabel="row (pixel)")
figure.colorbar(drawn, ax=[axes["c"], axes["d"]], label="pixel value", shrink=0.8)
plt.show()
