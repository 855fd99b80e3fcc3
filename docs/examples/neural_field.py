"""
A neural field on exact rays
============================

A small network can stand for the flame: it takes a point to the emission there, and waves of
many lengths and directions at its entrance (Tancik et al. 2020) let it have structures of their
size. It is evaluated at the voxel centres, emission is linear between them, and its weights are
trained on the images, along the rays of the cameras. One camera is left out to judge it.

The length of the waves is the prior: it was tuned on this flame, as is usual for such fields.
The default of the package chooses its smoothness from the images alone.
:doc:`/theory/differentiable_projection` has figures.
"""

import matplotlib.pyplot as plt
import numpy as np
import torch

import phantoms
import rigs
import tomo
from tomo.wernet import project

grid = tomo.VoxelGrid(shape=(16, 24, 16), spacing=1.0)  # mm
flame = phantoms.create("turbulent", extent=grid.extent)
ring = {"distance": 500, "image_size": (32, 48), "footprint": 0.55, "start_degrees": 8}
rig = rigs.ring(9, 170, **ring, pitch_degrees=[8, -8] * 4 + [8])
scan = tomo.simulate(rig, flame, grid, supersample=2, refine=3, noise=0.02, seed=1)
seen, images = rig.without("cam04"), dict(zip(rig.names, scan.images(), strict=True))
system = tomo.LinearSystem.from_rig(seen, grid).with_linear_basis()
measured = torch.from_numpy(system.flatten([images[name] for name in seen.names]))

torch.manual_seed(0)
points = torch.from_numpy(grid.centers().reshape(-1, 3) / max(grid.extent)).float()
waves = 2 * np.pi * points @ (1.3 * torch.randn(3, 64))  # in the grid's longest edge
encoded = torch.cat([waves.sin(), waves.cos()], dim=1)
layers = [torch.nn.Linear(128, 64), torch.nn.ReLU(), torch.nn.Linear(64, 64), torch.nn.ReLU()]
field = torch.nn.Sequential(*layers, torch.nn.Linear(64, 1), torch.nn.Softplus())
optimiser = torch.optim.Adam(field.parameters(), lr=0.003)
for _ in range(500):
    optimiser.zero_grad()
    emission = 0.3 * field(encoded).reshape(grid.shape)
    (project(emission, system) - measured).square().mean().backward()
    optimiser.step()

default = tomo.reconstruct(scan, options=tomo.Options(hold_out=("cam04",), screen=False)).volume
learned = tomo.operators.voxel_means(emission.detach().numpy())
volumes = {"truth": scan.truth, "default": default, "neural field": learned}
held = tomo.LinearSystem.from_rig(rig.without(*seen.names), grid).with_linear_basis()
figure, axes = plt.subplots(2, 3, figsize=(9, 9), layout="constrained")
tomo.draw.light_row(axes[0], volumes, grid)
for ax, (name, volume) in zip(axes[1], volumes.items(), strict=True):
    (view,) = held.images(held.projector.on_voxel_means @ volume.ravel())
    ax.imshow(view, "inferno", vmin=0, vmax=images["cam04"].max())
    ax.set(title="seen by cam04", xlabel="column (pixel)", ylabel="row (pixel)")
    error, psnr = tomo.metrics.nrmse(volume, scan.truth), tomo.metrics.psnr(view, images["cam04"])
    print(f"{name}: NRMSE {error:.3f}, PSNR of the view left out {psnr:.1f} dB")
plt.show()
