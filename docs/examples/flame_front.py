"""
The area of a flame front, and how sure it is
=============================================

How large is the surface that burns, how strongly is it bent, and how thick is it? The front is
where the emission passes half of that of the burnt gas. `tomo.Volume` gives its surface and its
area, and the values anywhere between voxels.

This front is wrinkled, its area is 26 % more than that of a ball, and it is known. Voxels cut
corners: the area that they miss falls with the square of their edge, and a copy on voxels twice as
wide tells how much that is. The intervals of the voxels tell the rest. An error that sharpens or
smooths the front changes its area most, so all of the error is taken to be of that kind: the
volume is changed by as much of the details that the wider voxels lack.
:doc:`/reference/volume` has every method of a volume, and :doc:`/theory/uncertainty` tells how the
intervals of voxels come about.
"""

import matplotlib.pyplot as plt
import numpy as np
import trimesh

import phantoms
import rigs
import tomo


def radius(points):  # of the front in the direction of points, mm
    return 12 + 1.5 * np.sin(6 * points / np.linalg.norm(points, axis=-1)[:, None]).sum(axis=-1)


def flame(points):  # burnt gas emits 1
    return 1 / (1 + np.exp(np.linalg.norm(points, axis=-1) - radius(points)))


def shape_of(volume):  # area, RMS of the curvature, thickness from 25 % to 75 %
    area = (4 * volume.area(0.5) - volume.resample(coarse).area(0.5)) / 3
    slopes = np.array(np.gradient(volume, *volume.grid.spacing))
    normal = -slopes / np.linalg.norm(slopes, axis=0).clip(1e-9)
    bend = sum(np.gradient(normal[k], volume.grid.spacing[k], axis=k) for k in range(3)) / 2
    front, steps = volume.isosurface(0.5), np.arange(-4, 4, 0.1)[:, None]  # mm
    curvature = volume.like(bend).sample(front.vertices)
    across = volume.sample(front.vertices[:, None] + steps * front.vertex_normals[:, None])
    thickness = 0.1 * ((across > 0.25) & (across < 0.75)).sum(axis=1).mean()
    return np.array([area, np.sqrt(np.mean(curvature**2)), thickness]), front, curvature


grid, coarse, fine = (tomo.VoxelGrid((n, n, n), 40 / n) for n in (40, 20, 80))
rig = rigs.ring(12, distance=500, image_size=(64, 64), footprint=0.75, pitch_degrees=[12, -12] * 6)
result = tomo.reconstruct(tomo.simulate(rig, flame, grid, supersample=2, refine=2, noise=0.01))
volume, half_width = result.volume, result.half_width

detail, near = volume - volume.resample(coarse).resample(grid), np.abs(volume - 0.5) < 0.2
wrong = detail * np.sqrt(np.mean(half_width[near] ** 2) / np.mean(detail[near] ** 2)) / 1.645
(found, front, curvature), *others = (shape_of(volume + k * wrong) for k in (0, -1, 1))
ends = np.sort([other[0] for other in others], axis=0)

ball = trimesh.creation.icosphere(6)
ball.vertices *= radius(ball.vertices)[:, None]
true = [ball.area, *shape_of(tomo.Volume(phantoms.sample(flame, fine, 2), fine))[0][1:]]
names = ("area (mm^2)", "curvature (1/mm)", "thickness (mm)")
for name, *figures in zip(names, true, found, *ends, strict=True):
    print("{}: true {:.3g}, found {:.3g}, from {:.3g} to {:.3g}".format(name, *figures))

how = {"b": {"projection": "3d", "title": "curvature: blue -0.3, red 0.3 per mm"}}
figure, axes = plt.subplot_mosaic("ab", figsize=(9, 4), layout="constrained", per_subplot_kw=how)
tomo.draw.light_row([axes["a"]], {"the volume": result})
drawn = axes["b"].plot_trisurf(*front.vertices[:, [2, 0, 1]].T, triangles=front.faces)
drawn.set(array=curvature[front.faces].mean(axis=1), clim=(-0.3, 0.3), cmap="coolwarm")
plt.show()
