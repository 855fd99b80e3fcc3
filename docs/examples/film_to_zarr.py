"""
A film, from cameras to a movie
===============================

Our cameras are fast and the flame moves: how do we get from hundreds of frames to a movie and to
curves over time? One call reconstructs a film into a Zarr store, a chunk a frame; it goes on
where a run was ended, and its memory does not grow with the film. xarray reads the store like
any data set, and one more call writes an mp4.

Frames of one film share one plan: bad pixels, gains, smoothness and how much neighbouring frames
count are settled once. :doc:`/guide/films` has the commands for the same, and how films of real
cameras are read.
"""

import matplotlib.pyplot as plt
import xarray

import phantoms
import rigs
import tomo
from tomo.export import export_series
from tomo.series import reconstruct_series
from tomo.simulation import simulate_film

grid = tomo.VoxelGrid(shape=(14, 36, 14), spacing=1.0)  # mm
flame = phantoms.create("jet", extent=grid.extent, seed=4)  # pulses 250 times a second
rig = rigs.ring(8, 44, distance=500, image_size=(28, 54), footprint=0.8, pitch_degrees=8)

# 24 frames, 1500 a second; the true volumes lie beside the images
how = {"supersample": 2, "refine": 2, "noise": 0.02, "seed": 1}
film = simulate_film(rig, flame, grid, "film", frames=24, frame_rate=1500, **how)

# these cameras are well calibrated; by default poses would be refined from the film
options = tomo.Options(frames=":", refine_cameras="none")
store = reconstruct_series(tomo.load_scan(film), "flame.zarr", options=options)
movie = export_series(store, "flame.mp4", "mp4")  # needs the package av

data = xarray.open_zarr("flame.zarr", consolidated=False)
truth = xarray.open_zarr("film/truth.zarr", consolidated=False).emission
error = abs(data.total_emission / truth.sum(["x", "y", "z"]) - 1).max()
print(f"{movie}: {movie.stat().st_size / 1e3:.0f} kB; total emission within {float(error):.1%}")

figure = plt.figure(figsize=(10, 7), layout="constrained")
strip, below = figure.subfigures(2, 1, height_ratios=(1.2, 1))
times = [1e3 * float(time) for time in data.time[8:16]]
shown = {f"{ms:.1f} ms": store.volume(8 + k) for k, ms in enumerate(times)}
tomo.draw.light_row(strip.subplots(1, 8), shown)
ax = below.subplots()
for height, colour in ((-12.5, "C0"), (-2.5, "C1")):
    found, true = (cube.sum(["x", "z"]).sel(y=height) for cube in (data.emission, truth))
    ax.plot(1e3 * data.time, found, "o-", color=colour, label=f"found, y = {height} mm")
    ax.plot(1e3 * data.time, true, "k--", label="true")
ax.set(title="pulses of the flow travel up", xlabel="time (ms)", ylabel="layer's light (mm$^2$)")
ax.legend(ncols=2)
plt.show()
