"""Temperatures of soot in a candle flame, from two scans through filters of 550 and 700 nm."""

from dataclasses import replace
from functools import partial

import numpy as np

import rigs
import tomo
from tomo.radiometry import planck_radiance, temperature_of_volumes
from tomo.scan import Calibration, Radiometry

WAVELENGTHS = (550.0, 700.0)  # nm
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


# one count of these cameras is 1e-3 W/m^2/sr/nm; see scan.yaml for spheres, exposures and filters
radiometry = Radiometry("W/m^2/sr/nm", Calibration(factor=1e-3))
volumes, deviations = [], []
for seed, nm in enumerate(WAVELENGTHS):
    images = tomo.simulate(rig, partial(soot, nm), grid, noise=0.02, seed=seed)
    scan = replace(images, radiometry=radiometry)
    result = tomo.reconstruct(scan, options=tomo.Options(method="tikhonov", uncertainty=10))
    volumes.append(result.volume)
    deviations.append(result.uncertainty.standard_deviation)

found, deviation = temperature_of_volumes(*volumes, WAVELENGTHS, deviations=deviations, faint=0.2)
known = np.isfinite(found)
error, deviation = (found - temperature(grid.centers()))[known], deviation[known]
size, predicted = (np.sqrt(np.mean(one**2)) for one in (error, deviation))
within = np.mean(np.abs(error) < 2 * deviation)
print(f"{known.sum()} voxels with soot, {found[known].mean():.0f} K on average")
print(f"errors of {size:.1f} K, predicted {predicted:.1f} K; {within:.0%} within two deviations")
