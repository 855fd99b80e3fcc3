"""
A red verdict, read and mended
==============================

The report says red: what now? Read the first reason, and do the first step. Here a camera is held
out to judge the volume, and is not predicted: the verdict names it, and says to check it. One look
at its image and at the prediction shows why. The camera hangs upside down from its bracket, and
the rig does not know. One line turns it in the rig, and the second verdict is that of the same
images with the mended rig.

The volume itself is right both times, as the camera had no part in it. Without ``hold_out`` the
default leaves such a view out by itself and names it. :doc:`/guide/reading_the_report` has the
reasons and steps, :doc:`/guide/troubleshooting` more.
"""

import matplotlib.pyplot as plt

import phantoms
import rigs
import tomo

grid = tomo.VoxelGrid(shape=(16, 28, 16), spacing=1.0)  # mm
flame = phantoms.create("jet", extent=grid.extent)
rig = rigs.ring(12, distance=500, image_size=(40, 54), footprint=0.75, pitch_degrees=[9, -9] * 6)
seen = tomo.simulate(rig, flame, grid, supersample=2, refine=2, noise=0.01, seed=1)
images = dict(zip(rig.names, seen.images(), strict=True))
images["cam03"] = images["cam03"][::-1, ::-1]  # upside down

volumes, views = {"truth": seen.truth}, {"measured": images["cam03"]}
for name in ("before", "after"):
    scan = tomo.Scan.from_arrays(rig, images, grid)
    result = tomo.reconstruct(scan, options=tomo.Options(hold_out=("cam03",)))
    print(f"{name}: {result.verdict.sentence}", *result.verdict.next, sep="\n- ")
    volumes[name] = result.volume
    views[f"predicted, {name}"] = result.views[3].reprojected
    # on the command line: flametomo convert-rig rig.yaml mended.yaml --rotate cam03=180
    rig = rigs.with_images_changed(rig, {"cam03": rigs.ImageChange(degrees=180)})

figure, axes = plt.subplots(2, 3, figsize=(9, 9), layout="constrained")
tomo.draw.light_row(axes[0], volumes, grid)
for ax, (name, image) in zip(axes[1], views.items(), strict=True):
    drawn = ax.imshow(image, "inferno", vmin=0, vmax=images["cam03"].max())
    ax.set(title=f"cam03, {name}", xlabel="column (pixel)", ylabel="row (pixel)")
figure.colorbar(drawn, ax=axes[1], label="pixel value", shrink=0.8)
plt.show()
