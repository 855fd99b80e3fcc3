"""
A knocked camera found by autograd
==================================

One camera was knocked after the calibration: its image is two pixels off. Its pose is a tensor
here, as the voxels are, and Adam finds both from the images. Rays are followed anew at every
step, and the gradient of the pose is that of the model's own columns. The other cameras hold
still, else all might move with the flame.

:doc:`/theory/differentiable_projection` has the formulas. The default finds such a camera by
itself; this is for a loop of your own, with losses and unknowns that the package does not have.
"""

import matplotlib.pyplot as plt
import numpy as np
import torch

import phantoms
import rigs
import tomo
from tomo.model import Pose
from tomo.model.pose import moved
from tomo.wernet import ImageModel

grid = tomo.VoxelGrid(shape=(16, 22, 16), spacing=1.0)  # mm
flame = phantoms.create("jet", extent=grid.extent)
ring = {"distance": 500, "image_size": (36, 48), "footprint": 0.55, "start_degrees": 8}
rig = rigs.ring(8, **ring, pitch_degrees=[8, -8] * 4)
cameras, knock = list(rig), np.array([2.0, -1.0, 0.5, 0, 0, 0])  # right, down, roll ... in pixels
cameras[1] = moved(cameras[1], knock, np.zeros(3))
scan = tomo.simulate(
    rigs.Rig(tuple(cameras)), flame, grid, supersample=2, refine=3, noise=0.01, seed=1
)
model = ImageModel(rig, grid, [Pose()], basis="linear")  # of the cameras before the knock
measured = torch.from_numpy(model.system.flatten(scan.images()))

root = torch.full(grid.shape, 0.3, requires_grad=True)  # its square is never negative
pose = torch.zeros(len(rig), 6, requires_grad=True)
free = torch.outer(torch.eye(len(rig))[1], torch.tensor([1.0, 1, 1, 0, 0, 0]))  # cam01 alone
optimiser = torch.optim.Adam([{"params": [root], "lr": 0.03}, {"params": [pose], "lr": 0.1}])
found = []
for _ in range(120):
    optimiser.zero_grad()
    (model(root.square(), pose=free * pose) - measured).square().mean().backward()
    optimiser.step()
    found.append((free * pose).detach()[1, :3].numpy().copy())

figure, axes = plt.subplot_mosaic("abcc", figsize=(10, 4), layout="constrained")
learned = tomo.operators.voxel_means(root.detach().square().numpy())
tomo.draw.light_row([axes["a"], axes["b"]], {"truth": scan.truth, "found": learned}, grid)
for values, name, true in zip(np.transpose(found), Pose.parameters, knock, strict=False):
    print(f"{name}: knocked by {true:+.1f} px, found {values[-1]:+.2f} px")
    (line,) = axes["c"].plot(values, label=name)
    axes["c"].axhline(true, color=line.get_color(), ls=":")
axes["c"].set(title="motion of cam01 (dotted: true)", xlabel="step", ylabel="pixels")
axes["c"].legend()
plt.show()
