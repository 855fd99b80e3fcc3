"""
Is my rig good enough?
======================

Eight cameras on one side of the flame, or all around: does it matter? Ask before you measure:
the check says which details a rig measures in every direction. A layer that no camera sees edge-on
is not measured, however many cameras there are. The volumes above it show what that means, and
where orange reaches the rim, the rig is blind.

:doc:`/guide/your_cameras` has the command ``check-rig``, :doc:`/theory/uncertainty` the formula.
"""

import matplotlib.pyplot as plt
import numpy as np

import phantoms
import rigs
import tomo

grid = tomo.VoxelGrid(shape=(32, 20, 32), spacing=1.0)  # mm
flame = phantoms.create("turbulent", extent=grid.extent, seed=1)
angles = np.radians(np.arange(0, 361, 2))
level = np.stack([np.sin(angles), 0 * angles, np.cos(angles)], axis=1)  # unit vectors
quick = tomo.Options(method="curvature", uncertainty=0, screen=False, refine_cameras="none")

figure, volumes = plt.figure(figsize=(10, 9), layout="constrained"), {}
light, blind = figure.subfigures(2, 1)
for column, (name, step) in enumerate((("within 40 degrees", 40 / 7), ("half a circle", 22.5))):
    rig = rigs.ring(8, step, distance=500, image_size=(64, 44), footprint=0.6)
    check = rigs.check_rig(rig, grid)
    print(f"8 cameras, {name}: {check.resolved.words('mm')}")
    finest = np.median(check.views_of_volume.wavelengths(level), axis=0)  # over the points
    scan = tomo.simulate(rig, flame, grid, supersample=2, refine=2, noise=0.02)
    result = tomo.reconstruct(scan, options=quick)
    print(f"its volume: {result.report()['quality']['nrmse']:.0%} error")
    volumes[name] = result.volume

    axes = blind.add_subplot(1, 2, column + 1, projection="polar")
    axes.set(theta_zero_location="N", theta_direction=-1, rlim=(0, 32), rlabel_position=200)
    axes.fill_between(angles, np.minimum(finest, 32), color="#c8511b", alpha=0.35)
    bearings = [np.arctan2(camera.position[0], camera.position[2]) for camera in rig]
    axes.plot(bearings, [30] * 8, "v", color="#1b6fb0")
    axes.set_title(f"cameras (triangles) {name}:\nfinest detail, by direction (mm)")
shown = {"truth": scan.truth} | volumes
tomo.draw.light_row(light.subplots(1, 3), shown, grid, eye=(28, 75))  # nearly from above
plt.show()
