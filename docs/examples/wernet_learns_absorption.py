"""
WERNet learns absorption that nobody wrote down
===============================================

My gas absorbs its own light, and I do not know how strongly. Can the images tell? Segment
lengths say that all light arrives. Where it does not, the volume comes out dim, most where the
flame is brightest. WERNet learns weights in place of segment lengths from the same images, and
keeps them only where they predict pixels that it left out better. A nearly axisymmetric flame can
hide its absorption: a dimmer flame gives nearly the same images.

:doc:`/theory/wernet` says how, :doc:`/results/mismatch` for which effects it pays.
"""

import matplotlib.pyplot as plt
import numpy as np

import phantoms
import rigs
import tomo
from tomo.simulation.effects import Effects

grid = tomo.VoxelGrid(shape=(14, 20, 14), spacing=1.0)  # mm
places = [[-2.2, -3.0, 0.5], [1.8, 0.0, -1.4], [-0.5, 4.0, 1.2]]
flame = phantoms.GaussianBlobs(np.array(places), [1.5, 1.7, 1.4], [1.0, 0.8, 0.6])
rig = rigs.ring(10, distance=300, image_size=(40, 44), footprint=0.6, pitch_degrees=[15, -10] * 5)

# a quarter of the light is absorbed on its way out; no reconstruction is told
how = {"supersample": 2, "refine": 2, "noise": 0.005, "seed": 1}
scan = tomo.simulate(rig, flame, grid, effects=Effects(self_absorption=0.3), **how)
volumes, errors = {"truth": scan.truth}, {}
for name, method in (("segment lengths", "curvature"), ("WERNet", "wernet")):
    result = tomo.reconstruct(scan, options=tomo.Options(method=method, uncertainty=0))
    volumes[name], errors[name] = result.volume, result.report()["quality"]["nrmse"]
    print(f"{name}: error {errors[name]:.0%} (NRMSE)")

layout = {"layout": "constrained", "height_ratios": [3, 2]}
figure, axes = plt.subplot_mosaic("AABBCC;DDDEEE", figsize=(9, 8), **layout)
(x0, y0, _), (x1, y1, _) = grid.lower, grid.upper
how = {"extent": (x0, x1, y0, y1), "origin": "lower", "vmin": 0, "vmax": scan.truth.max()}
*panels, profile, weights = axes.values()
for panel, colour, name in zip(panels, ("k", "#1b6fb0", "#c8511b"), volumes, strict=True):
    panel.imshow(volumes[name][:, :, 7].T, "inferno", **how)
    panel.set(title=name, xlabel="x (mm)", ylabel="y (mm)")
    profile.plot(grid.axes()[1], volumes[name][5, :, 7], color=colour, label=name)
profile.set(title="profile at x = -1.5 mm", xlabel="y (mm)", ylabel="emission")
profile.legend()
learned = result.report()["learned"]["profiles"]["upstream emission"]
weights.plot(learned["centre"], learned["truth"], "k", label="truth")
weights.plot(learned["centre"], learned["weight"], "o", color=colour, label="learned")
weights.set(title="light that gets out (relative)", xlabel="emission in its way")
weights.legend()
title = "Segment lengths: {segment lengths:.0%} error; learned weights, same images: {WERNet:.0%}"
figure.suptitle(title.format(**errors), weight="bold")
plt.show()
