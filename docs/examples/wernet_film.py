"""
One encoder for the frames of a film
====================================

Five cameras film a jet. Multi-WERNet (Applied Optics 60, 6469, 2021) lets all frames share the
encoder of the WERNet paper, and each keep its voxels. In as many epochs the encoder takes as many
more steps as there are frames, which is nearly all that sharing buys. The figure compares it with
an encoder for one frame alone, and with ART, which learns nothing and stays ahead of both.

:doc:`/results/paper` has the same on eight frames, :doc:`/theory/wernet` the formulas.
"""

import matplotlib.pyplot as plt
import numpy as np

import phantoms
import rigs
import tomo
from tomo.wernet import wernet_paper, wernet_paper_frames

grid = tomo.VoxelGrid(shape=(15, 40, 15), spacing=1.0)  # mm
pitch = [15, -15, 15, -15, 15]
rig = rigs.ring(5, 36, 5800, image_size=(34, 66), footprint=0.67, pitch_degrees=pitch)
jet = phantoms.create("jet", 0, grid.extent, grid.center)
film = np.array([phantoms.sample(jet.at(0.01 * frame), grid) for frame in range(4)])
projector = tomo.LinearSystem.from_rig(rig, grid, midpoints=True).projector
measured = np.array([projector @ projector.active.compress(truth) for truth in film])

curves = {}


def watch(name):
    """Return a callback that keeps the cosine distance of the first frame from its truth."""

    def callback(index, volume, residual):
        found = projector.active.expand(np.atleast_2d(volume)[0])
        curves.setdefault(name, {})[index] = tomo.metrics.cosine_distance(found, film[0].ravel())

    return callback


how = {"iterations": 12}
shared = wernet_paper_frames(projector, measured, callback=watch("one encoder"), **how)
alone = wernet_paper(projector, measured[0], callback=watch("one frame"), **how)
tomo.solvers.art(projector, measured[0], relaxation=1.0, callback=watch("ART"), **how)

figure, axes = plt.subplot_mosaic("ABC;DDD", figsize=(8, 8.5), layout="constrained")
volumes = {"truth": film[0], "one encoder": shared[0].volume, "one frame": alone.volume}
tomo.draw.light_row([axes[key] for key in "ABC"], volumes, grid)
for name, curve in curves.items():
    axes["D"].semilogy(list(curve), list(curve.values()), label=name)
axes["D"].set(xlabel="epochs, or passes", ylabel="cosine distance of the first frame")
axes["D"].legend()
for name, curve in curves.items():
    print(f"{name}: least cosine distance {min(curve.values()):.4f}")
plt.show()
