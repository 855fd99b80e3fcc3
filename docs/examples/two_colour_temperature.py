"""
Temperatures of soot from two colours
=====================================

How hot is the soot inside of our flame, and how far is the figure to be trusted? Two scans through
narrow filters give the emission at two wavelengths in every voxel. Their ratio gives a temperature
there, not one averaged along the line of sight, and the deviations of the volumes give that of the
temperature.

:doc:`/theory/radiometry` has the formulas, and says how counts become radiances.
"""

from dataclasses import replace
from functools import partial

import matplotlib.pyplot as plt
import numpy as np

import rigs
import tomo
from tomo.radiometry import planck_radiance, temperature_of_volumes
from tomo.scan import Calibration, Radiometry

grid = tomo.VoxelGrid(shape=(16, 28, 16), spacing=1.25)  # mm
rig = rigs.ring(12, distance=500, image_size=(40, 60), footprint=0.75, pitch_degrees=10)


def temperature(points):
    """Return kelvins: hot outside, where soot burns, and cooler in the core."""
    return 1500 + 300 * np.minimum(np.hypot(points[..., 0], points[..., 2]) / 7, 1)


def soot(wavelength, points):
    """Return emission in W/m^3/sr/nm: grey soot of up to 5 per metre."""
    x, y, z = np.moveaxis(points, -1, 0)
    absorption = 5 * np.exp(-(((x**2 + z**2) / 36) ** 2) - (y / 11) ** 4)
    return absorption * planck_radiance(wavelength, temperature(points))


# one count of these cameras is 1e-3 W/m^2/sr/nm
radiometry = Radiometry("W/m^2/sr/nm", Calibration(factor=1e-3))
wavelengths, volumes, deviations = (550.0, 700.0), [], []  # nm
for seed, nm in enumerate(wavelengths):
    how = {"supersample": 2, "refine": 2, "noise": 0.02, "seed": seed}
    scan = replace(tomo.simulate(rig, partial(soot, nm), grid, **how), radiometry=radiometry)
    result = tomo.reconstruct(scan, options=tomo.Options(method="tikhonov", uncertainty=10))
    volumes.append(result.volume)
    deviations.append(result.uncertainty.standard_deviation)

found, deviation = temperature_of_volumes(*volumes, wavelengths, deviations=deviations, faint=0.2)
true, known = temperature(grid.centers()), np.isfinite(found)
error, deviation = np.abs(found - true), np.where(known, deviation, np.nan)
size, predicted = (np.sqrt(np.nanmean(of**2)) for of in (error, deviation))
print(f"{known.sum()} voxels with soot, {found[known].mean():.0f} K on average")
print(f"errors of {size:.1f} K, predicted {predicted:.1f} K")

figure, axes = plt.subplots(1, 4, figsize=(12, 4.2), layout="constrained")
for ax, values, title, colours, (low, high) in (
    (axes[0], np.where(known, true, np.nan), "truth", "inferno", (1450, 1850)),
    (axes[1], found, "found", "inferno", (1450, 1850)),
    (axes[2], error, "|found - truth|", "viridis", (0, 30)),
    (axes[3], deviation, "predicted deviation", "viridis", (0, 30)),
):
    cut, box = values[:, :, 8].T, (-10, 10, -17.5, 17.5)
    drawn = ax.imshow(cut, colours, extent=box, origin="lower", vmin=low, vmax=high)
    ax.set(title=title, xlabel="x (mm)", ylabel="y (mm)")
    figure.colorbar(drawn, ax=ax, label="K")
plt.show()
