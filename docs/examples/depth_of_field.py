"""
A flame deeper than the depth of field
======================================

We need all the light we can get, so our lenses are wide open, and only the middle of the flame is in
focus. Is the volume blurred too? Reconstructed as if lenses were pinholes, it is. If each pixel's rays
start all over the aperture and cross in the plane in focus, as light does, most details come back.

The rig has to know f-number, focal length and focus distance: :doc:`/guide/depth_of_field` says how
they are written down and what it costs.
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
volumes = {"truth": scan.truth}
for name, rays in (("rays over the aperture", 24), ("pinholes", 1)):
    options = tomo.Options(method="curvature", supersample=2, aperture_rays=rays, uncertainty=0)
    result = tomo.reconstruct(scan, options=options)
    name += f":\nerror {result.report()['quality']['nrmse']:.0%}"
    volumes[name] = result.volume
    print(name.replace("\n", " "), result.report()["seconds"]["total"])

figure, axes = plt.subplots(1, 4, figsize=(12, 3.6), layout="constrained")
axes[0].imshow(scan.images()[0], "gray")
axes[0].set(title="image of camera 0", xlabel="column", ylabel="row")
for ax, (name, volume) in zip(axes[1:], volumes.items(), strict=True):
    cut, box = volume[:, 12].T, (-24, 24, -24, 24)
    drawn = ax.imshow(cut, "inferno", extent=box, origin="lower", vmin=0, vmax=scan.truth.max())
    ax.set(title=name, xlabel="x (mm)", ylabel="z (mm)")
figure.colorbar(drawn, ax=axes[1:], label="emission")
plt.show()
