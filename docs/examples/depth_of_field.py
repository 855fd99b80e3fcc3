"""
A flame deeper than the depth of field
======================================

We need all the light we can get, so our lenses are wide open, and only the middle of the flame
is in focus. Is the volume blurred too? Reconstructed as if lenses were pinholes, it is. If each
pixel's rays start all over the aperture and cross in the plane in focus, as light does, most
details come back.

The rig has to know f-number, focal length and focus distance: :doc:`/guide/depth_of_field` says
how they are written down and what it costs.
"""

from dataclasses import replace

import matplotlib.pyplot as plt

import phantoms
import rigs
import tomo
from tomo.simulation.effects import Effects

grid = tomo.VoxelGrid(shape=(32, 32, 32), spacing=1.5)  # mm
flame = phantoms.create("turbulent", extent=grid.extent, seed=4)

# f/1.4 and 100 mm, 250 mm away: discs of four voxels at both ends of the grid
lens = rigs.Optics(focal_length=100, f_number=1.4, focus_distance=250)
cameras = rigs.ring(10, distance=250, image_size=(46, 46), footprint=1.5)
rig = rigs.Rig(tuple(replace(camera, optics=lens) for camera in cameras))

how = {"supersample": 2, "refine": 2, "noise": 0.01, "seed": 1}
open_lens = Effects(aperture="optics", aperture_rays=64)
scan = tomo.simulate(rig, flame, grid, effects=open_lens, **how)
figure, axes = plt.subplot_mosaic("abc;def", figsize=(10, 7), layout="constrained")
axes["d"].imshow(scan.images()[0], "gray")
axes["d"].set(title="image of camera 0", xlabel="column (pixel)", ylabel="row (pixel)")
volumes = {"truth": scan.truth}
for key, name, rays in (("e", "aperture", 24), ("f", "pinholes", 1)):
    options = tomo.Options(method="curvature", supersample=2, aperture_rays=rays, uncertainty=0)
    result = tomo.reconstruct(scan, options=options)
    volumes[name] = result.volume
    print(f"{name}: error {result.report()['quality']['nrmse']:.0%}")
    how = {"vmin": -0.3, "vmax": 0.3, "extent": (-24, 24, -24, 24), "origin": "lower"}
    drawn = axes[key].imshow((result.volume - scan.truth)[:, 12].T, "RdBu_r", **how)
    axes[key].set(title=f"{name}, a level plane", xlabel="x (mm)", ylabel="z (mm)")
figure.colorbar(drawn, ax=[axes["e"], axes["f"]], label="volume - truth", shrink=0.8)
tomo.draw.light_row([axes[key] for key in "abc"], volumes, grid)
plt.show()
