"""A deep flame through open lenses: reconstructed with rays over the aperture, and as pinholes."""

from dataclasses import replace

import phantoms
import rigs
import tomo
from tomo.simulation.effects import Effects

grid = tomo.VoxelGrid(shape=(40, 40, 40), spacing=1.5)
flame = phantoms.create("blobs", extent=grid.extent, seed=3)

# f/2.8 and 100 mm, 300 mm away: discs of up to 5 mm, three voxels, at both ends of the grid
lens = rigs.Optics(focal_length=100, f_number=2.8, focus_distance=300)
cameras = rigs.ring(12, distance=300, image_size=(56, 56), footprint=1.5)
rig = rigs.Rig(tuple(replace(camera, optics=lens) for camera in cameras))

how = {"supersample": 2, "refine": 2, "noise": 0.01, "seed": 1}
open_lens = Effects(aperture="optics", aperture_rays=64)
scan = tomo.simulate(rig, flame, grid, effects=open_lens, **how)
for name, rays in (("depth of field modelled", 32), ("pinholes", 1)):
    options = tomo.Options(supersample=2, aperture_rays=rays, uncertainty=0)
    result = tomo.reconstruct(scan, options=options)
    print(f"{name}: NRMSE {result.report()['quality']['nrmse']:.3f}")
