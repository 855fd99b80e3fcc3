"""
The same rays as RTK
====================

Does the projector compute what another program computes? `RTK <https://www.openrtk.org>`_ has
projectors for X-ray cameras, with many years behind them. A circle of cameras without distortion is a
circular X-ray scan: its rays can be given to both.

The images agree where the volume is smooth. Differences are those of the models: RTK's Joseph
projector interpolates between voxels, ours has exact lengths in voxels of constant emission. The bars
are times of the machine that built this page, both programs on all its cores;
:doc:`/results/benchmark` has more sizes. ``pip install itk-rtk`` brings RTK.
"""

from statistics import median
from timeit import repeat

import itk
import matplotlib.pyplot as plt
import numpy as np
from itk import RTK as rtk

import phantoms
import rigs
import tomo

n, views, pixels, distance = 64, 24, 96, 1000.0
grid = tomo.VoxelGrid(shape=(n, n, n), spacing=1.0)  # mm
volume = phantoms.sample(phantoms.create("turbulent", extent=grid.extent, seed=4), grid, 2)
volume = volume.astype(np.float32)

rig = rigs.ring(views, distance=distance, image_size=(pixels, pixels), footprint=1.0)
A = tomo.LinearSystem.from_rig(rig, grid, form="on-the-fly", skip=False).projector

geometry = rtk.ThreeDCircularProjectionGeometry.New()
for view in range(views):  # the detector stands behind the volume: RTK's rays end at it
    geometry.AddProjection(distance, 2 * distance, 360 / views * view)


def itk_image(values, pitch):
    """Return the ITK image, centred at the origin, of an array ``[z, y, x]``."""
    image = itk.image_from_array(np.ascontiguousarray(values, np.float32))
    image.SetSpacing([pitch] * 3)
    image.SetOrigin([-(size - 1) / 2 * pitch for size in values.shape[::-1]])
    return image


def with_rtk():
    """Return RTK's images, ``(views, rows, columns)``; rows of its detector run upwards."""
    kind = itk.Image[itk.F, 3]
    projector = rtk.JosephForwardProjectionImageFilter[kind, kind].New()
    projector.SetGeometry(geometry)
    projector.SetInput(0, itk_image(np.zeros((views, pixels, pixels)), 2.0))
    projector.SetInput(1, itk_image(volume.transpose(2, 1, 0), 1.0))
    projector.Update()
    return itk.array_from_image(projector.GetOutput())[:, ::-1]


images, times = {}, {}
for name, project in (("tomo", lambda: A @ volume.ravel()), ("RTK", with_rtk)):
    images[name] = project().reshape(views, pixels, pixels)  # the first call warms up
    times[name] = 1e3 * median(repeat(project, number=1, repeat=7))
difference = images["RTK"] - images["tomo"]
size = np.linalg.norm(difference) / np.linalg.norm(images["tomo"])
print(f"difference {size:.1%}; tomo {times['tomo']:.0f} ms, RTK {times['RTK']:.0f} ms, medians of 7")

figure, axes = plt.subplots(1, 4, figsize=(12, 3.4), layout="constrained")
most = images["tomo"].max()
for ax, (name, image) in zip(axes, images.items(), strict=False):
    figure.colorbar(ax.imshow(image[5], "inferno", vmin=0, vmax=most), ax=ax, label="mm")
    ax.set(title=f"{name}, camera 5", xlabel="column", ylabel="row")
drawn = axes[2].imshow(difference[5], "RdBu", vmin=-0.1 * most, vmax=0.1 * most)
figure.colorbar(drawn, ax=axes[2], label="mm")
axes[2].set(title=f"RTK - tomo: {size:.1%}", xlabel="column")
axes[3].bar(times.keys(), times.values(), color=["C0", "0.6"])
axes[3].set(title=f"{views} images of {pixels} x {pixels}", ylabel="ms on this machine")
plt.show()
