"""Two views on one camera: the left half of the image looks by a mirror from the side."""

import numpy as np

import phantoms
import rigs
import tomo
from rigs.scene import Mirror, Scene

grid = tomo.VoxelGrid(shape=(12, 16, 12), spacing=1.0)
flame = phantoms.create("turbulent", extent=grid.extent, seed=4)

# 60 mm beside the flame a mirror turns the view by 90 degrees
mirror = Mirror("side", point=(60, 0, 0), normal=(-1, 0, 1), size=(40, 40))
R, t = rigs.look_at((30, 0, 500), (30, 0, 0))
lens = [[700, 0, 49.5], [0, 700, 15.5], [0, 0, 1]]
both = rigs.Camera("both", (100, 32), lens, R=R, t=t)
others = rigs.ring(4, 45, distance=400, image_size=(24, 30), footprint=0.7)[1::2]
rig = rigs.Rig((both, *others), volume=rigs.Volume(grid.shape, grid.spacing))

for name, seen in (("by the mirror too", rig.through(Scene([mirror]))), ("directly", rig)):
    scan = tomo.simulate(seen, flame, grid, supersample=2, refine=2, noise=0.01, seed=1)
    result = tomo.reconstruct(scan, options=tomo.Options(uncertainty=0))
    image = scan.images()[0]
    lit = (image > 0.2 * image.max()).any(axis=0)
    views = (np.diff(np.flatnonzero(lit)) > 5).sum() + 1
    print(f"{name}: {views} views of the flame on one camera,", end=" ")
    print(f"NRMSE {result.report()['quality']['nrmse']:.3f}")
