"""
How many cameras do I need?
===========================

Will six cameras do, or must I buy twelve? It depends on the flame: a smooth jet is good with
four, a wrinkled one keeps gaining up to about twelve. Run this with your own grid, pixels and
noise before you order: the curve is flat where these limit the volume, and no longer the views.

:doc:`/guide/limits` says what no number of cameras can do.
"""

import matplotlib.pyplot as plt

import phantoms
import rigs
import tomo

FLAMES = (("jet", 0, "#1b6fb0"), ("turbulent", 3, "#c8511b"))
COUNTS = (3, 4, 5, 6, 8, 12, 16, 24)
grid = tomo.VoxelGrid(shape=(24, 24, 24), spacing=1.0)  # mm
fine = grid.refined(2)
quick = tomo.Options(method="curvature", uncertainty=0, screen=False, refine_cameras="none")

figure = plt.figure(figsize=(10, 9), layout="constrained")
*lights, curves = figure.subfigures(3, 1, height_ratios=[1, 1, 1.2])
axes = curves.subplots()
for light, (name, seed, colour) in zip(lights, FLAMES, strict=True):
    flame = phantoms.create(name, extent=grid.extent, seed=seed)
    flame, errors = phantoms.SampledField(phantoms.sample(flame, fine, 2), fine), []
    volumes = {}
    for count in COUNTS:
        # over a half circle: a camera opposite another one adds little
        rig = rigs.ring(count, 180 / count, distance=400, image_size=(48, 40), footprint=0.7)
        scan = tomo.simulate(rig, flame, grid, supersample=2, refine=2, noise=0.02)
        result = tomo.reconstruct(scan, options=quick)
        errors.append(100 * result.report()["quality"]["nrmse"])
        if count in (3, 6, 12):
            volumes[f"{count} cameras"] = result.volume
    shown = {f"{name}, truth": scan.truth} | volumes
    tomo.draw.light_row(light.subplots(1, 4), shown, grid)
    axes.plot(COUNTS, errors, "o-", color=colour, label=f"{name} flame")
    print(f"{name}: {errors[0]:.0f} % error with 3 cameras, {errors[5]:.0f} % with 12")
axes.set(xscale="log", ylim=(0, None), xlabel="cameras", ylabel="error (NRMSE, %)")
axes.set_xticks(COUNTS, COUNTS)
axes.minorticks_off()
axes.grid(alpha=0.3)
axes.legend()
plt.show()
