"""
Noise, and the choice of a prior
================================

My images are noisy. How strongly should the volume be smoothed, and which method do I take? Too
many iterations, or too weak a prior, turn photon noise into grain; too few, or too strong a prior,
blur the flame. The default chooses by predicting pixels that it left out. Here it is the best from
30 photons to 10 000, without having seen the truth.

:doc:`/guide/choosing_a_method` lists the methods, :doc:`/theory/model_selection` how it chooses.
"""

import matplotlib.pyplot as plt

import phantoms
import rigs
import tomo

PHOTONS = (30, 200, 1500, 10_000)  # in the brightest pixel
METHODS = {
    "mlem, 200 iterations (long)": ("#7d5ba6", {"method": "mlem", "iterations": 200}),
    "mlem, 5 iterations (short)": ("#178060", {"method": "mlem", "iterations": 5}),
    "total variation": ("#c8511b", {"method": "tv"}),
    "the default": ("#1b2733", {"fit_gain": False, "fit_absorption": False}),
}
grid = tomo.VoxelGrid(shape=(18, 20, 18), spacing=1.0)  # mm
rig = rigs.ring(9, 20, distance=400, image_size=(36, 34), footprint=0.65)
flame = phantoms.create("turbulent", extent=grid.extent, seed=2)
flame = phantoms.SampledField(phantoms.sample(flame, grid.refined(2), 2), grid.refined(2))
how = {"supersample": 2, "refine": 2, "seed": 1}
scans = [tomo.simulate(rig, flame, grid, photons=photons, **how) for photons in PHOTONS]

figure = plt.figure(figsize=(10, 7.5), layout="constrained")
light, curves = figure.subfigures(2, 1, height_ratios=(1, 1.1))
axes, shown = curves.subplots(), {"truth": scans[0].truth}
for name, (colour, chosen) in METHODS.items():
    options = tomo.Options(uncertainty=0, screen=False, refine_cameras="none", **chosen)
    found = [tomo.reconstruct(scan, options=options) for scan in scans]
    errors = [100 * one.report()["quality"]["nrmse"] for one in found]
    print(f"{name}: errors of {', '.join(f'{error:.0f} %' for error in errors)}")
    axes.loglog(PHOTONS, errors, "o-", color=colour, label=name)
    shown[name.replace(", ", ",\n")] = found[0].volume
axes.set(xlabel="photons in the brightest pixel", ylabel="error (NRMSE, %)")
axes.set_yticks((20, 30, 50, 70), (20, 30, 50, 70))
axes.minorticks_off()
axes.grid(alpha=0.3)
axes.legend()
tomo.draw.light_row(light.subplots(1, 5), shown, grid)
light.suptitle("From images with 30 photons in the brightest pixel")
plt.show()
