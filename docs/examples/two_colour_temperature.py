"""
Temperatures of soot from two colours
=====================================

How hot is the soot inside of our flame, and how far is the figure to be trusted? Two scans
through narrow filters give the emission at two wavelengths in every voxel. Their ratio gives a
temperature there, not one averaged along the line of sight, and the deviations of the volumes
give that of the temperature.

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


def temperature(points):  # in kelvins: hot outside, where soot burns, and cooler in the core
    return 1500 + 300 * np.minimum(np.hypot(points[..., 0], points[..., 2]) / 7, 1)


def soot(wavelength, points):  # in W/m^3/sr/nm: grey, absorbs up to 5 per metre
    x, y, z = np.moveaxis(points, -1, 0)
    absorption = 5 * np.exp(-(((x**2 + z**2) / 36) ** 2) - (y / 11) ** 4)
    return absorption * planck_radiance(wavelength, temperature(points))


radiometry = Radiometry("W/m^2/sr/nm", Calibration(factor=1e-3))  # the radiance of one count
options = tomo.Options(method="tikhonov", uncertainty=10)
how, wavelengths, results = {"supersample": 2, "refine": 2, "noise": 0.02}, (550.0, 700.0), []
for seed, nm in enumerate(wavelengths):
    counts = tomo.simulate(rig, partial(soot, nm), grid, seed=seed, **how)
    results.append(tomo.reconstruct(replace(counts, radiometry=radiometry), options=options))
volumes = [result.volume for result in results]
deviations = [result.uncertainty.standard_deviation for result in results]
found, sigma = temperature_of_volumes(*volumes, wavelengths, deviations=deviations, faint=0.2)
sigma, true = np.where(np.isfinite(found), sigma, np.nan), temperature(grid.centers())
size, predicted = (np.sqrt(np.nanmean(of**2)) for of in (found - true, sigma))
print(f"{np.isfinite(found).sum()} voxels: errors of {size:.0f} K, predicted {predicted:.0f} K")

figure, axes = plt.subplot_mosaic("aabb;cdee", figsize=(10, 10), layout="constrained")
tomo.draw.light_row([axes["a"], axes["b"]], {"550 nm": results[0], "700 nm": results[1]})
for key, values, title in (("c", found, "temperature"), ("d", sigma, "its deviation")):
    drawn = axes[key].imshow(values[:, :, 8].T, extent=(-10, 10, -17.5, 17.5), origin="lower")
    figure.colorbar(drawn, label="K", shrink=0.6)
    axes[key].set(title=title, xlabel="x (mm)", ylabel="y (mm)")
x, middle, ax = grid.axes()[0], (slice(2, 14), 14, 8), axes["e"]
ax.plot(x[2:14], true[middle], "k--", label="truth")
ax.errorbar(x[2:14], found[middle], 2 * sigma[middle], fmt="C1o", label="found, 2 deviations")
ax.set(title="through the middle", xlabel="x (mm)", ylabel="temperature (K)")
ax.legend()
plt.show()
