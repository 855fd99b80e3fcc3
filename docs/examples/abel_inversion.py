"""
Abel inversion or tomography?
=============================

Our burner is round and we own one camera: is Abel inversion enough? If the flame is round it is,
and needs one image where tomography needs several. A flame that burns brighter on the far side
makes the very same image, and Abel inversion returns the same round flame: nothing in the image
can warn of it. Eight cameras see the difference.

Abel inversion is that of `PyAbel <https://pyabel.readthedocs.io>`_, which expects parallel rays,
so these cameras stand far away. One camera without symmetry leaves the depth open, see
:doc:`/guide/limits`.
"""

from functools import partial

import abel
import matplotlib.pyplot as plt
import numpy as np

import rigs
import tomo

grid = tomo.VoxelGrid(shape=(32, 12, 32), spacing=0.5)  # mm
camera = {"distance": 5000, "image_size": (65, 30), "footprint": 0.25}
one, eight = rigs.ring(1, **camera), rigs.ring(8, 22.5, **camera)
x, _, z = np.moveaxis(grid.centers()[:, 6], -1, 0)  # of the middle plane


def flame(lopsided, points):
    """Return a hollow cylinder of light; the side away from camera 0 is brighter."""
    radius, z = np.hypot(points[..., 0], points[..., 2]), points[..., 2]
    return np.exp(-(((radius - 4) / 1.5) ** 2)) * (1 - lopsided * np.tanh(z / 2))


options = tomo.Options(method="curvature", uncertainty=0)
daun = {"dr": 0.25, "reg": ("diff", 30), "verbose": False}
figure, axes = plt.subplot_mosaic("abcd;efgh;iijj", figsize=(10, 9), layout="constrained")
for name, side, keys, below in (("round", 0, "abcd", "i"), ("one-sided", 0.4, "efgh", "j")):
    how = {"supersample": 2, "refine": 2, "noise": 0.01, "seed": 1}
    scan = tomo.simulate(eight, partial(flame, side), grid, **how)
    rows = scan.images()[0].astype(float)
    daun = {"dr": 0.25, "reg": ("diff", 30), "verbose": False}
    inverted = abel.Transform(rows, method="daun", symmetry_axis=0, transform_options=daun)
    middle = np.interp(np.hypot(x, z), 0.25 * np.arange(33), inverted.transform[15, 32:])
    alone = tomo.Scan.from_arrays(one, {"cam00": rows}, grid)
    found = {
        f"{name} flame": scan.truth,
        "Abel, 1 camera": np.repeat(middle[:, None], 12, axis=1),  # the row at half height
        "ours, 1 camera": tomo.reconstruct(alone, options=options).volume,
        "ours, 8 cameras": tomo.reconstruct(scan, options=options).volume,
    }
    tomo.draw.light_row([axes[key] for key in keys], found, grid, eye=(20, 55))
    for title, volume in found.items():
        axes[below].plot(z[16], volume[16, 6], "k--" if "flame" in title else "-", label=title)
    errors = [tomo.metrics.nrmse(volume[:, 6], scan.truth[:, 6]) for volume in found.values()]
    errors = ", ".join(f"{error:.0%}" for error in errors[1:])
    print(f"{name} flame: errors of Abel inversion, one camera, eight cameras: {errors}")
    axes[below].set(xlabel="z (mm)", ylabel="emission", ylim=(0, 1.5))
    axes[below].legend(ncols=2, fontsize=8)
plt.show()
