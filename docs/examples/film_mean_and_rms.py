"""
Mean and fluctuation of a film
==============================

A flame that moves is described by its mean and by its fluctuation about it. How do we get both
from a film without holding it in memory? `tomo.mean_and_rms` takes one frame at a time, and both
come back as a `tomo.Volume`: sampled along a line, drawn and compared like any frame.

This tongue of flame sways from side to side, and its RMS is largest on either side of the mean.
Frames must stand for themselves here: means over neighbouring frames, which the default takes
where they predict left-out views better, made the RMS of this film too small by a seventh. The
true values are those of the volumes that the film was simulated from. :doc:`/guide/films` tells
how films of real cameras are read.
"""

import matplotlib.pyplot as plt
import numpy as np

import rigs
import tomo
from tomo.io import VolumeFilm
from tomo.simulation import simulate_film


class SwayingFlame:
    time = 0.0

    def at(self, time):
        flame = SwayingFlame()
        flame.time = time
        return flame

    def __call__(self, points):
        x, y, z = np.moveaxis(points, -1, 0)
        sway = 0.12 * (y + 16) * np.sin(2 * np.pi * 125 * self.time - y / 8)  # mm, at 125 Hz
        return np.exp(-((x - sway) ** 2 + z**2) / 8 - (y / 12) ** 4)


grid = tomo.VoxelGrid(shape=(18, 32, 14), spacing=1.0)  # mm
rig = rigs.ring(8, 44, distance=500, image_size=(34, 54), footprint=0.7, pitch_degrees=8)
how = {"supersample": 2, "refine": 2, "noise": 0.02, "seed": 1}
film = simulate_film(rig, SwayingFlame(), grid, "sway", frames=12, frame_rate=1500, **how)
# these cameras are well calibrated; means over neighbouring frames would fluctuate less
options = tomo.Options(frames=":", refine_cameras="none", temporal="off")
store = tomo.reconstruct_series(tomo.load_scan(film), "sway.zarr", options=options)

truth = VolumeFilm("sway/truth.zarr")
found = tomo.mean_and_rms(store.volumes())
true = tomo.mean_and_rms(truth.read(k) for k in range(truth.n_frames))
print("NRMSE of mean and RMS:", np.round([*map(tomo.metrics.nrmse, found, true)], 4))

keys = dict(zip("abcd", ("mean, true", "mean, found", "RMS, true", "RMS, found"), strict=True))
volumes = [volume for pair in zip(true, found, strict=True) for volume in pair]
figure, axes = plt.subplot_mosaic("abcd;eeee", figsize=(10, 8), layout="constrained")
for pair in ("ab", "cd"):
    shown = {keys[key]: volumes["abcd".index(key)] for key in pair}
    tomo.draw.light_row([axes[key] for key in pair], shown, eye=(0, 5))
for name, one, other in zip(("mean", "RMS"), found, true, strict=True):
    across = [volume.profile((-9, 6, 0), (9, 6, 0), 37)[1] for volume in (one, other)]
    (drawn,) = axes["e"].plot(np.linspace(-9, 9, 37), across[0], "o", label=f"{name}, found")
    axes["e"].plot(np.linspace(-9, 9, 37), across[1], color=drawn.get_color(), label="true")
axes["e"].set(title="across the flame, y = 6 mm", xlabel="x (mm)", ylabel="emission")
axes["e"].legend()
plt.show()
