"""
Gains and backgrounds
=====================

Our cameras were never calibrated against each other, and light of the room is in every image.
Does that spoil the volume? Ignored, it does. Fitted, it does not: every view of a flame records
the same total light, and pixels beside the flame record the background alone, so the images
themselves tell both.

Gains come out within two per cent, and backgrounds within the noise of a pixel, here 0.05.
Without ``fit_gain`` the default decides by itself whether to fit them. One factor common to all
cameras stays unknown without a source of known radiance, see :doc:`/theory/radiometry`. The
lines for ``scan.yaml`` that store the corrections are in :doc:`/guide/your_images`.
"""

import matplotlib.pyplot as plt
import numpy as np

import phantoms
import rigs
import tomo
from tomo.simulation.effects import Effects

grid = tomo.VoxelGrid(shape=(16, 32, 16), spacing=1.0)  # mm
flame = phantoms.create("jet", extent=grid.extent, seed=4)
rig = rigs.ring(12, 29, distance=500, image_size=(48, 72), footprint=0.6, pitch_degrees=8)

# gains differ by 15 %, backgrounds are up to 5 % of the brightest pixel
how = {"supersample": 2, "refine": 2, "noise": 0.01, "seed": 1}
dark_room = tomo.simulate(rig, flame, grid, effects=Effects(gain_spread=0.15), **how)
background = np.random.default_rng(2).uniform(0, 0.05, len(rig)) * np.max(dark_room.images())
images = zip(rig.names, dark_room.images(), background, strict=True)
images = {name: image + light for name, image, light in images}
scan = tomo.Scan.from_arrays(rig, images, grid, truth=dark_room.truth)

volumes = {"truth": scan.truth}
plain = {"screen": False, "refine_cameras": "none", "uncertainty": 0}
for name, fit in (("ignored", False), ("fitted", True)):
    result = tomo.reconstruct(scan, options=tomo.Options(fit_gain=fit, **plain))
    volumes[name] = result.volume
    print(f"gains and backgrounds {name}: error {result.report()['quality']['nrmse']:.0%}")

true = np.array(list(dark_room.effects["gains"].values()))
gain, offset = (np.array(list(result.gains[key].values())) for key in ("gain", "offset"))
true *= np.exp(np.log(gain / true).mean())  # the factor common to all is not in the images
print(f"gains within {np.abs(gain / true - 1).max():.1%}")

figure, axes = plt.subplot_mosaic("aabbcc;dddeee", figsize=(9, 9), layout="constrained")
tomo.draw.light_row([axes[key] for key in "abc"], volumes, grid)
for key, marks in (("d", (true, gain)), ("e", (background, offset))):
    axes[key].plot(marks[0], "ks", fillstyle="none", markersize=8, label="true")
    axes[key].plot(marks[1], "C1x", markersize=8, label="found")
axes["d"].set(title="gains", xlabel="camera", ylabel="gain")
axes["e"].set(title="backgrounds", xlabel="camera", ylabel="pixel value")
axes["d"].legend()
plt.show()
