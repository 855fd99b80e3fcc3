"""
The same rays as RTK
====================

Does the projector compute what another program computes? `RTK <https://www.openrtk.org>`_ has
projectors for X-ray cameras, with many years behind them. A circle of cameras without distortion
is a circular X-ray scan: its rays can be given to both.

The images agree to a few per cent, and differ at edges of the flame only: RTK's Joseph projector
interpolates between voxels, ours has exact lengths in voxels of constant emission. The bars are
times of the machine that built this page, both programs on all its cores;
:doc:`/results/benchmark` has more sizes. ``pip install itk-rtk`` brings RTK.
"""

from timeit import repeat

import itk
import matplotlib.pyplot as plt
import numpy as np
from itk import RTK as rtk  # noqa: N811

import phantoms
import rigs
import tomo

grid = tomo.VoxelGrid(shape=(64, 64, 64), spacing=1.0)  # mm
volume = phantoms.sample(phantoms.create("jet", extent=grid.extent, seed=4), grid, 2)
rig = rigs.ring(24, distance=1000, image_size=(128, 128), footprint=0.5)
A = tomo.LinearSystem.from_rig(rig, grid, form="on-the-fly", skip=False).projector

# the detector stands behind the volume, because RTK's rays end at it; its pixels are 1 mm
geometry = rtk.ThreeDCircularProjectionGeometry.New()
for view in range(24):
    geometry.AddProjection(1000, 2000, 15 * view)


def itk_image(values):  # an array [z, y, x], centred at the origin
    image = itk.image_from_array(np.ascontiguousarray(values, np.float32))
    image.SetOrigin([-(size - 1) / 2 for size in values.shape[::-1]])
    return image


def with_rtk():  # rows of its detector run upwards
    kind = itk.Image[itk.F, 3]
    projector = rtk.JosephForwardProjectionImageFilter[kind, kind].New()
    projector.SetGeometry(geometry)
    projector.SetInput(0, itk_image(np.zeros((24, 128, 128))))
    projector.SetInput(1, itk_image(volume.transpose(2, 1, 0)))
    projector.Update()
    return itk.array_from_image(projector.GetOutput())[:, ::-1]


functions = {"ours": lambda: A @ volume.ravel(), "RTK": with_rtk}
ours, theirs = (f().reshape(24, 128, 128) for f in functions.values())  # warms up, too
times = [1e3 * np.median(repeat(f, number=1, repeat=9)) for f in functions.values()]
apart = tomo.metrics.nrmse(theirs, ours)
print(f"images differ by {apart:.1%}; ours in {times[0]:.0f} ms, RTK's in {times[1]:.0f} ms")

figure, axes = plt.subplots(1, 4, figsize=(13, 3.4), layout="constrained")
tomo.draw.light_row(axes[:1], {"the volume": volume}, grid)
figure.colorbar(axes[1].imshow(ours[5], "inferno"), ax=axes[1], label="ours: line integral (mm)")
drawn = axes[2].imshow((theirs - ours)[5], "RdBu", clim=(-1, 1))
figure.colorbar(drawn, label="RTK's - ours (mm)")
axes[3].bar([f"{name} (ms)" for name in functions], times)
plt.show()
