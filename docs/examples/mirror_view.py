"""
Two views on one camera
=======================

We own too few cameras: can a mirror make two of one? It can. The right half of this camera's
image looks by a mirror at the flame's side. With the mirror in the rig's scene, each pixel
follows its own way, by the mirror or directly, and the camera counts as two views.

:doc:`/theory/optics` says how, and :doc:`/reference/rig_yaml` how a mirror is written down. The
mirror's place comes from your design, or from boards that are seen by it.
"""

import matplotlib.pyplot as plt

import phantoms
import rigs
import tomo
from rigs.scene import Mirror, Scene

grid = tomo.VoxelGrid(shape=(16, 24, 16), spacing=1.0)  # mm
flame = phantoms.create("turbulent", extent=grid.extent, seed=4)

# 60 mm beside the flame a mirror turns the view by 90 degrees
mirror = Mirror("side", point=(60, 0, 0), normal=(-1, 0, 1), size=(50, 50))
R, t = rigs.look_at((30, 0, 500), (30, 0, 0))
lens = [[700, 0, 59.5], [0, 700, 23.5], [0, 0, 1]]
both = rigs.Camera("both", (120, 48), lens, R=R, t=t)
others = rigs.ring(4, 45, distance=400, image_size=(36, 48), footprint=0.7)[1::2]
rig = rigs.Rig((both, *others), volume=rigs.Volume(grid.shape, grid.spacing))

how = {"supersample": 2, "refine": 2, "noise": 0.01, "seed": 1}
options = tomo.Options(uncertainty=0, screen=False, refine_cameras="none")
volumes, images = {}, []
for name, seen in (("without mirror", rig), ("with mirror", rig.through(Scene([mirror])))):
    scan = tomo.simulate(seen, flame, grid, **how)
    result = tomo.reconstruct(scan, options=options)
    print(f"{name}: error {result.report()['quality']['nrmse']:.0%}")
    volumes[name] = result.volume
    images.append((name, scan.images()[0]))

figure, axes = plt.subplot_mosaic("aabbcc;dddeee", figsize=(10, 7.5), layout="constrained")
shown = {"truth": scan.truth} | volumes
tomo.draw.light_row([axes[key] for key in "abc"], shown, grid, eye=(28, 30))
for key, (name, image) in zip("de", images, strict=True):
    axes[key].imshow(image, "gray")
    axes[key].set(title=f"image {name}", xlabel="column (pixel)", ylabel="row (pixel)")
plt.show()
