"""
A flame behind windows
======================

Our burner stands in a chamber, and every camera looks through a thick pane of quartz that is not
square to it. Do the windows matter? A pane shifts the line of sight sideways, here by one and a
half voxels. Cameras that were calibrated without the windows no longer meet in one point behind
them. Named in the rig's scene, the windows do no harm.

:doc:`/theory/optics` says how light is followed, and :doc:`/reference/rig_yaml` how windows are
written into ``rig.yaml``.
"""

from dataclasses import replace

import matplotlib.pyplot as plt
import numpy as np

import phantoms
import rigs
import tomo
from rigs.scene import Glass, Scene, Window

grid = tomo.VoxelGrid(shape=(16, 24, 16), spacing=1.0)  # mm
flame = phantoms.create("turbulent", extent=grid.extent, seed=4)
rig = rigs.ring(8, 44, distance=400, image_size=(36, 48), footprint=0.7)

# every camera looks through its own pane, 60 mm from the flame, 25 degrees out of square
panes = []
for number, camera in enumerate(rig):
    towards = camera.position / np.linalg.norm(camera.position)
    normal = towards + np.tan(np.radians(25)) * camera.R[number % 2]
    panes.append(Window(f"pane {number}", 60 * towards, normal, 10, Glass("quartz"), size=24))

behind_glass = rig.through(Scene(panes))
scan = tomo.simulate(behind_glass, flame, grid, supersample=2, refine=2, noise=0.01, seed=1)
volumes = {"truth": scan.truth}
plain = tomo.Options(uncertainty=0, screen=False, refine_cameras="none")
for name, cameras in (("windows in the scene", behind_glass), ("windows forgotten", rig)):
    result = tomo.reconstruct(replace(scan, rig=cameras), options=plain)
    print(f"{name}: error {result.report()['quality']['nrmse']:.0%}")
    volumes[name] = result.volume

figure, axes = plt.subplots(2, 3, figsize=(9, 9), layout="constrained")
tomo.draw.light_row(axes[0], volumes, grid)
for ax, volume in zip(axes[1], volumes.values(), strict=True):
    cut, box = volume[:, :, 8].T, (-8, 8, -12, 12)
    drawn = ax.imshow(cut, "inferno", extent=box, origin="lower", vmin=0, vmax=scan.truth.max())
    ax.set(title="plane z = 0.5 mm", xlabel="x (mm)", ylabel="y (mm)")
figure.colorbar(drawn, ax=axes[1], label="emission", shrink=0.8)
plt.show()
