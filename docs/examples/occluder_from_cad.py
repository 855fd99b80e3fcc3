"""
Hardware in front of the flame
==============================

A holder hides part of the flame from some of our cameras. Do we have to mask the images by hand?
Put the holder's CAD file into the rig's scene: pixels that look at hardware drop out, also where
a voxel is hidden from one camera only.

Forgotten, it is noticed here: the verdict's first reason says that pixels of one camera are darker
than the seven others can explain, and they are left out as well. Do not count on it where
hardware stands before several cameras: :doc:`/results/optics` has a rod before three of twelve,
which made the error 2.3 times as large.
:doc:`/reference/rig_yaml` lists the files of meshes that are read, and :doc:`/theory/optics`
says how rays end at them.
"""

from dataclasses import replace

import matplotlib.pyplot as plt
import trimesh

import phantoms
import rigs
import tomo
from rigs.scene import Mesh, Opaque, Scene
from rigs.scene.entry import read_mesh

holder = trimesh.creation.cylinder(radius=4, height=60, sections=48)  # stands for your CAD file
holder.apply_transform(trimesh.transformations.rotation_matrix(1.5708, [1, 0, 0], [0, 0, 0]))
holder.apply_translation([2, 0, 40])
holder.export("holder.stl")

grid = tomo.VoxelGrid(shape=(16, 24, 16), spacing=1.0)  # mm
flame = phantoms.create("turbulent", extent=grid.extent, seed=4)
rig = rigs.ring(8, 44, distance=400, image_size=(36, 48), footprint=0.7)
vertices, triangles = read_mesh("holder.stl")
with_holder = rig.through(Scene([Mesh("holder", vertices, triangles, Opaque())]))
scan = tomo.simulate(with_holder, flame, grid, supersample=2, refine=2, noise=0.01, seed=1)
found = {"truth": scan.truth}
options = tomo.Options(uncertainty=0, screen=False, refine_cameras="none")
for name, cameras in (("holder in the scene", with_holder), ("holder forgotten", rig)):
    result = tomo.reconstruct(replace(scan, rig=cameras), options=options)
    print(f"{name}: error {result.report()['quality']['nrmse']:.0%}")
    print("-", result.verdict.reasons[0])
    found[name] = result.volume

figure, axes = plt.subplot_mosaic("abc;def", figsize=(9, 9), layout="constrained")
tomo.draw.light_row([axes[key] for key in "abc"], found, grid)
axes["d"].imshow(scan.images()[0], "gray")
axes["d"].set(title="camera 0 sees the holder", xlabel="column (pixel)", ylabel="row (pixel)")
for key, (name, volume) in zip("ef", list(found.items())[1:], strict=True):
    how = {"vmin": -0.5, "vmax": 0.5, "extent": (-8, 8, -12, 12), "origin": "lower"}
    drawn = axes[key].imshow((volume - scan.truth)[:, :, 8].T, "RdBu_r", **how)
    axes[key].set(title=name, xlabel="x (mm)", ylabel="y (mm)")
figure.colorbar(drawn, ax=[axes["e"], axes["f"]], label="volume - truth, z = 0.5 mm", shrink=0.8)
plt.show()
