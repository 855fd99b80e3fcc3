"""
The network of the WERNet paper
===============================

I have read Pan, Li and Xu (2020) and want to see their network at work: voxels and the weights of
all rays in them are trained together, from the images of one flame. The figure shows how near each
epoch comes to the truth, beside the passes of ART, to which the paper compares it, and beside the
default.

:doc:`/theory/wernet` has the formulas, :doc:`/results/paper` repeats the paper claim by claim.
"""

import matplotlib.pyplot as plt

import phantoms
import rigs
import tomo

grid = tomo.VoxelGrid(shape=(14, 20, 14), spacing=1.0)  # mm
flame = phantoms.create("turbulent", 1, grid.extent, grid.center)
rig = rigs.ring(12, distance=300, image_size=(28, 40), footprint=0.5, pitch_degrees=[15, -15] * 6)
scan = tomo.simulate(rig, flame, grid, supersample=2, refine=2, noise=0.01, seed=1)

epochs = {"WERNet (paper)": ("wernet-paper", 15), "ART": ("art", 15), "default": ("auto", None)}
found = {
    name: tomo.reconstruct(scan, method=method, iterations=number, uncertainty=0)
    for name, (method, number) in epochs.items()
}
volumes = {"truth": scan.truth} | {name: one.volume for name, one in found.items()}

figure, axes = plt.subplot_mosaic("ABCD;EEEE", figsize=(10, 8), layout="constrained")
tomo.draw.light_row([axes[key] for key in "ABCD"], volumes, grid)
for name, colour in (("WERNet (paper)", "#c8511b"), ("ART", "#1b6fb0")):
    history = [one for one in found[name].solution.history if one.index]
    steps, distances = zip(*((one.index, one.distance) for one in history), strict=True)
    axes["E"].semilogy(steps, distances, color=colour, label=name)
best = found["default"].report()["quality"]["cosine_distance"]
axes["E"].axhline(best, color="k", ls=":", label="default")
axes["E"].set(xlabel="epochs, or passes", ylabel="cosine distance from the truth")
axes["E"].legend()
for name, one in found.items():
    print(f"{name}: cosine distance {one.report()['quality']['cosine_distance']:.5f}")
plt.show()
