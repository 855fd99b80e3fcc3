"""
WERNet learns optics that no formula covers
===========================================

The filters before my cameras pass some columns of pixels better than others: fringes, which
nobody calibrated. No formula of cameras, lenses and gas has them. WERNet learns weights in
place of segment lengths from the same images, and keeps them only where they predict pixels
that it left out better. Poses, gains and gas are known here: nothing else is looked for, and
nothing else takes the blame.

:doc:`/theory/wernet` says how, :doc:`/results/mismatch` for which effects it pays.
"""

import matplotlib.pyplot as plt
import numpy as np

import phantoms
import rigs
import tomo

grid = tomo.VoxelGrid(shape=(14, 20, 14), spacing=1.0)  # mm
places = [[-2.2, -3.0, 0.5], [1.8, 0.0, -1.4], [-0.5, 4.0, 1.2]]
flame = phantoms.GaussianBlobs(np.array(places), [1.5, 1.7, 1.4], [1.0, 0.8, 0.6])
rig = rigs.ring(12, distance=300, image_size=(28, 40), footprint=0.5, pitch_degrees=[15, -10] * 6)
scan = tomo.simulate(rig, flame, grid, supersample=2, refine=2, noise=0.005, seed=1)

fringes = (1 + 0.3 * np.sin(0.36 * np.arange(28) - 5)).astype(np.float32)  # what filters pass
images = {name: fringes * image for name, image in zip(rig.names, scan.images(), strict=True)}
scan = tomo.Scan.from_arrays(rig, images, grid=grid, truth=scan.truth)

volumes, errors = {"truth": scan.truth}, {}
how = {"screen": False, "refine_cameras": "none", "fit_absorption": False, "uncertainty": 0}
for name, method in (("default", "auto"), ("WERNet", "wernet")):
    result = tomo.reconstruct(scan, options=tomo.Options(method=method, **how))
    volumes[name], errors[name] = result.volume, result.report()["quality"]["nrmse"]
    print(f"{name}: error {errors[name]:.0%} (NRMSE)")

layout = {"layout": "constrained", "height_ratios": [3, 2]}
figure, axes = plt.subplot_mosaic("AABBCC;DDDEEE", figsize=(9, 8), **layout)
(x0, y0, _), (x1, y1, _) = grid.lower, grid.upper
how = {"extent": (x0, x1, y0, y1), "origin": "lower", "vmin": 0, "vmax": scan.truth.max()}
*panels, profile, passed = axes.values()
for panel, colour, name in zip(panels, ("k", "#1b6fb0", "#c8511b"), volumes, strict=True):
    panel.imshow(volumes[name][:, :, 7].T, "inferno", **how)
    panel.set(title=name, xlabel="x (mm)", ylabel="y (mm)")
    profile.plot(grid.axes()[1], volumes[name][5, :, 7], color=colour, label=name)
profile.set(title="profile at x = -1.5 mm", xlabel="y (mm)", ylabel="emission")
profile.legend()
system = tomo.LinearSystem.from_rig(rig, grid)
plain = system.images(system.projector @ result.volume.ravel())  # by segment lengths
seen = [view.reprojected for view in result.views]  # by learned weights
passed.plot(fringes, "k", label="truth")
passed.plot(np.sum(seen, (0, 1)) / np.maximum(np.sum(plain, (0, 1)), 1), "o", color=colour)
passed.set(title="light that the filters pass; dots: learned", xlabel="column", ylim=(0.5, 1.5))
title = "Default: {default:.0%} error; learned weights, same images: {WERNet:.0%}"
figure.suptitle(title.format(**errors), weight="bold")
plt.show()
