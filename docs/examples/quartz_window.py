"""A flame behind quartz windows: reconstructed with the windows in the scene, and without."""

from dataclasses import replace

import numpy as np

import phantoms
import rigs
import tomo
from rigs.scene import Glass, Scene, Window

grid = tomo.VoxelGrid(shape=(12, 16, 12), spacing=1.0)
flame = phantoms.create("turbulent", extent=grid.extent, seed=4)
rig = rigs.ring(8, 44, distance=400, image_size=(24, 30), footprint=0.7)

# every camera looks through its own pane, 60 mm from the flame, 25 degrees out of square
panes = []
for number, camera in enumerate(rig):
    towards = camera.position / np.linalg.norm(camera.position)
    normal = towards + np.tan(np.radians(25)) * camera.R[number % 2]
    panes.append(Window(f"pane {number}", 60 * towards, normal, 10, Glass("quartz"), size=20))

behind_glass = rig.through(Scene(panes))
scan = tomo.simulate(behind_glass, flame, grid, supersample=2, refine=2, noise=0.01, seed=1)
plain = tomo.Options(uncertainty=0, screen=False, align=False, learn=False)
for name, cameras in (("windows modelled", behind_glass), ("windows ignored", rig)):
    result = tomo.reconstruct(replace(scan, rig=cameras), options=plain)
    print(f"{name}: NRMSE {result.report()['quality']['nrmse']:.3f}")
