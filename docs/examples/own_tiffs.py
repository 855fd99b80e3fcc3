"""
Your own TIFFs, with dark and flat frames
=========================================

We have a folder of TIFFs: images, some frames with the caps on, and a flat field of each camera.
How do they become a scan? ``flametomo init run7`` finds all of it by names, looks where cameras
look and images are bright, and writes ``scan.yaml``; here Python does the same. Each line that it
says is a comment in that file, and those with "assumed" are to be checked.

The files are written first, as such cameras write them: 12 bits in 16, a dark level with a warm
corner, less light towards the edges. Left in the images, both end up in the volume: as a haze, and
as a flame too dim on its outside. :doc:`/guide/your_images` has the command and its options.
"""

import matplotlib.pyplot as plt
import numpy as np

import phantoms
import rigs
import tomo
from rigs.recordings import write_image
from tomo.scan.propose import Request, propose_scan, write_proposal

grid = tomo.VoxelGrid(shape=(16, 24, 16), spacing=1.0)  # mm
flame = phantoms.create("turbulent", extent=grid.extent, seed=4)
rig = rigs.ring(8, 44, distance=500, image_size=(48, 60), footprint=0.65, pitch_degrees=8)
seen = tomo.simulate(rig, flame, grid, supersample=2, refine=2)
full, random = 3000 / 4095 / np.max(seen.images()), np.random.default_rng(1)
rows, columns = np.mgrid[-1:1:60j, -1:1:48j]
rigs.save_rig(rig, "run7/rig.yaml")


def counts(level):  # of 4095, with noise
    return (4095 * level + random.normal(0, 8, level.shape)).clip(0, 4095).astype(np.uint16)


for name, image in zip(rig.names, seen.images(), strict=True):
    dark = 0.05 + 0.08 * np.exp(rows - 1 + columns - 1) + random.normal(0, 0.004, image.shape)
    flat = (1 - 0.25 * (rows**2 + columns**2)) * random.normal(1, 0.02, image.shape)
    write_image(f"run7/{name}/0001.tif", counts(dark + full * image * flat))
    write_image(f"run7/flat/{name}.tif", flat.astype(np.float32))  # over that in the middle
    for number in range(5):
        write_image(f"run7/dark/{name}/{number}.tif", counts(dark))

volumes = {"truth": tomo.Volume(full * seen.truth, grid)}
camera = {"bit_depth": 12, "voxel": 1.0}  # what files of 16 bits do not say; the edge in mm
ignored = Request(dark="none", flat="none", **camera)
for name, request in (("dark and flat off", Request(**camera)), ("as they are", ignored)):
    found = propose_scan("run7", request)  # flametomo init run7
    result = tomo.reconstruct(tomo.load_scan(write_proposal(found, force=True)), uncertainty=0)
    volumes[name] = result.volume.resample(grid)  # the box that was found is another one
    error = tomo.metrics.nrmse(result.volume, full * phantoms.sample(flame, found.grid, 2))
    print(f"{name}: {found.grid.shape} voxels, error {error:.0%}, {result.verdict.level}")

figure, axes = plt.subplot_mosaic("abc;def", figsize=(9, 8.5), layout="constrained")
tomo.draw.light_row([axes[key] for key in "abc"], volumes)
shown = {"image": counts(dark + full * image * flat), "dark": counts(dark), "flat": flat}
for key, (title, pixels) in zip("def", shown.items(), strict=True):
    figure.colorbar(axes[key].imshow(pixels, "gray"), ax=axes[key])
    axes[key].set(title=f"{title}, cam07", xlabel="column (pixel)")
plt.show()
