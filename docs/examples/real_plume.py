"""
A real plume
============

Enough of simulations: what becomes of a real plume of fog? Four cameras make the volume, and the
fifth, between them, is predicted. No truth is known; the prediction and the verdict are all there
is. The images are those of ScalarFlow (Eckert, Um and Thuerey, ACM TOG 38, 239, 2019), as HyFluid
packs them with a ``transforms.json``, which every command reads as a scan.

They are no part of this project. Name the folder that holds the set ``scalarflow`` in
``TOMO_TEST_DATA``, and this example runs; without it, it says so and draws nothing else.
:doc:`/results/benchmark` has figures at three times this resolution.
"""

import os
from dataclasses import replace
from pathlib import Path

import matplotlib.pyplot as plt

import tomo

path = Path(os.environ.get("TOMO_TEST_DATA", "no folder named")) / "scalarflow/transforms.json"


if path.is_file():
    lower, upper = (0.0818, -0.0446, -0.4958), (0.5727, 0.6917, -0.0049)  # m
    grid = tomo.VoxelGrid.from_bounds((32, 48, 32), lower, upper)
    scan = replace(tomo.load_scan(path), grid=grid).scaled(12)
    options = tomo.Options(frame="90", hold_out=("cam02",), uncertainty=0)
    result = tomo.reconstruct(scan, options=options)
    held_out = result.report()["held_out"]["cam02"]
    print(f"cam02, held out: predicted to {held_out['psnr']:.1f} dB, SSIM {held_out['ssim']:.2f}")
    print(result.verdict.sentence)

    figure, axes = plt.subplot_mosaic("abcd", figsize=(11, 4.5), layout="constrained")
    for key, azimuth, title in (("a", 90, "from the front"), ("b", 0, "from the side")):
        tomo.draw.light_row([axes[key]], {f"plume, {title}": result}, eye=(azimuth, 5))
    (view,) = (view for view in result.views if view.name == "cam02")
    for key, image, title in (
        ("c", view.measured, "measured"),
        ("d", view.reprojected, "predicted"),
    ):
        axes[key].imshow(image, "inferno", vmin=0, vmax=view.measured.max())
        axes[key].set(title=f"cam02: {title}", xlabel="column (pixel)", ylabel="row (pixel)")
else:
    print(f"skipped: found no file {path}, expected a folder of image sets in TOMO_TEST_DATA")
    plt.figure(figsize=(6, 2)).text(0.5, 0.5, "The images of the plume are not here.", ha="center")
plt.show()
