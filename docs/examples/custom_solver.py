"""
Your own solver in twenty lines
===============================

You have an idea for an iteration. How do you try it on real camera geometry? The cameras and
voxels are a linear operator: ``A @ x`` makes images of a volume, ``A.T @ y`` sends images back,
exactly transposed, in parallel and without a matrix where that does not fit. Everything else is
NumPy.

Here Nesterov's accelerated gradient descent with the bound ``x >= 0`` takes nine lines, and
keeps up with solvers of the package. Errors rise again after some iterations: every solver then
fits the noise, which is why the default chooses when to stop. :doc:`/develop/adding_a_solver`
makes such a function a method of the command line.
"""

import matplotlib.pyplot as plt
import numpy as np

import phantoms
import rigs
import tomo

grid = tomo.VoxelGrid(shape=(16, 32, 16), spacing=1.0)  # mm
flame = phantoms.create("jet", extent=grid.extent)
rig = rigs.ring(10, 35, distance=500, image_size=(40, 64), footprint=0.7, pitch_degrees=8)
scan = tomo.simulate(rig, flame, grid, supersample=2, refine=2, noise=0.01, seed=1)

system = tomo.LinearSystem.from_rig(rig, grid)
A, measured = system.projector, system.flatten(scan.images())


def accelerated(A, b, iterations, callback):
    """Minimise ``||b - A x||^2`` with ``x >= 0`` by Nesterov's accelerated gradient descent."""
    step = 1 / (A.row_sums.max() * A.column_sums.max())  # below 1 / ||A||^2
    x = ahead = np.zeros(A.shape[1], np.float32)
    for k in range(iterations):
        new = np.maximum(ahead + step * (A.T @ (b - A @ ahead)), 0)
        ahead, x = new + k / (k + 3) * (new - x), new  # a step further in the same direction
        callback(k + 1, x, np.linalg.norm(b - A @ x) / np.linalg.norm(b))
    return x


truth = A.active.compress(scan.truth)  # in the order of the operator's columns
solvers = {"yours: accelerated gradient": accelerated}
solvers |= {f"built in: {name}": getattr(tomo.solvers, name) for name in ("projected_cg", "sirt")}
figure, axes = plt.subplot_mosaic("abcd;eeff", figsize=(10, 8), layout="constrained")
found = {"truth": scan.truth}  # and of each solver its nearest volume
for name, solver in solvers.items():
    history = []
    solver(A, measured, iterations=100, callback=lambda *state: history.append(state))  # noqa: B023
    steps, volumes, residuals = zip(*history, strict=True)
    errors = [np.linalg.norm(x - truth) / np.linalg.norm(truth) for x in volumes]
    print(f"{name}: residual {residuals[-1]:.4f}, least error {min(errors):.3f}")
    nearest = A.active.expand(volumes[np.argmin(errors)]).reshape(grid.shape)
    found[name.replace(": ", ":\n")] = nearest
    axes["e"].loglog(steps, residuals, label=name)
    axes["f"].loglog(steps, errors)
tomo.draw.light_row([axes[key] for key in "abcd"], found, grid)
axes["e"].set(xlabel="iteration", title="relative residual")
axes["f"].set(xlabel="iteration", title="error of the volume")
axes["e"].legend()
plt.show()
