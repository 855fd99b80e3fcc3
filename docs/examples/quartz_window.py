"""A flame behind quartz windows: reconstructed with the windows in the scene, and without."""

from dataclasses import replace

import numpy as np

import phantoms
import rigs
import tomo
from rigs.scene import Glass, Scene, Window

grid = tomo.VoxelGrid(shape=(24, 32, 24), spacing=1.0)
flame = phantoms.create("turbulent", extent=grid.extent, seed=4)
rig = rigs.ring(12, distance=400, image_size=(56, 72), footprint=0.6)

# every camera looks through its own pane, 40 mm from the flame, 25 degrees out of square
panes = []
for number, camera in enumerate(rig):
    towards = camera.position / np.linalg.norm(camera.position)
    normal = towards + np.tan(np.radians(25)) * camera.R[number % 2]
    panes.append(Window(f"pane {number}", 60 * towards, normal, 10, Glass("quartz"), size=25))

scan = tomo.simulate(
    rig.through(Scene(panes)), flame, grid, supersample=2, refine=2, noise=0.01, seed=1
)
for name, seen in (("windows modelled", scan.rig), ("windows ignored", rig)):
    result = tomo.reconstruct(replace(scan, rig=seen), options=tomo.Options(uncertainty=0))
    print(f"{name}: NRMSE {result.report()['quality']['nrmse']:.3f}")
