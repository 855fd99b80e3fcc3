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

volumes = {"truth": scan.truth}
how = {"screen": False, "refine_cameras": "none", "fit_absorption": False, "uncertainty": 0}
for name, method in (("default", "auto"), ("WERNet", "wernet")):
    result = tomo.reconstruct(scan, options=tomo.Options(method=method, **how))
    volumes[name] = result.volume
    print(f"{name}: error {result.report()['quality']['nrmse']:.0%} (NRMSE)")

figure, axes = plt.subplot_mosaic("AABBCC;DDDEEE", figsize=(9, 9), layout="constrained")
tomo.draw.light_row([axes[key] for key in "ABC"], volumes, grid)
colours = {"truth": "k", "default": "#1b6fb0", "WERNet": "#c8511b"}
for name, colour in colours.items():
    axes["D"].plot(grid.axes()[1], volumes[name][5, :, 7], color=colour, label=name)
axes["D"].set(title="profile at x = -1.5 mm", xlabel="y (mm)", ylabel="emission")
axes["D"].legend()
system = tomo.LinearSystem.from_rig(rig, grid)
plain = system.images(system.projector @ result.volume.ravel())  # by segment lengths
seen = [view.reprojected for view in result.views]  # by learned weights
learned = np.sum(seen, (0, 1)) / np.maximum(np.sum(plain, (0, 1)), 1)
axes["E"].plot(fringes, "k", label="truth")
axes["E"].plot(learned, "o", color=colours["WERNet"], label="learned")
axes["E"].set(title="light that the filters pass", xlabel="column (pixel)", ylim=(0.5, 1.5))
axes["E"].legend()
plt.show()
