"""A holder from a CAD file hides part of the flame from two cameras; the scene says which."""

from pathlib import Path
from tempfile import TemporaryDirectory

import trimesh

import phantoms
import rigs
import tomo
from rigs.scene import Mesh, Opaque, Scene
from rigs.scene.mesh_file import read_mesh

with TemporaryDirectory() as folder:  # a stand-in for the file of your CAD program
    holder = trimesh.creation.cylinder(radius=1.5, height=60, sections=48)
    holder.apply_transform(trimesh.transformations.rotation_matrix(1.5708, [1, 0, 0], [0, 0, 0]))
    holder.apply_translation([3, 0, 60])
    holder.export(Path(folder) / "holder.stl")
    vertices, triangles = read_mesh(Path(folder) / "holder.stl")

grid = tomo.VoxelGrid(shape=(12, 16, 12), spacing=1.0)
flame = phantoms.create("turbulent", extent=grid.extent, seed=4)
rig = rigs.ring(8, 44, distance=400, image_size=(24, 30), footprint=0.7)
scene = Scene([Mesh("holder", vertices, triangles, Opaque())])
scan = tomo.simulate(rig.through(scene), flame, grid, supersample=2, refine=2, noise=0.01, seed=1)
result = tomo.reconstruct(scan, options=tomo.Options(uncertainty=0))
print(f"NRMSE {result.report()['quality']['nrmse']:.3f}")
for camera in scan.rig:
    paths, _ = camera.paths()
    print(camera.name, "sees", f"{1 - (paths.ends != 0).mean():.0%} of its pixels past the holder")
