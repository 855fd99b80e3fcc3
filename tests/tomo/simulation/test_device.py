"""Images that are computed on a device are those of the CPU."""

import numpy as np
import pytest

import rigs
from phantoms import create
from tomo import VoxelGrid, load_scan
from tomo.simulation import simulate_film, simulate_images
from tomo.simulation.effects import Effects

GRID = VoxelGrid((8, 10, 8), 1.0)
RIG = rigs.ring(2, distance=60.0, image_size=(14, 16), footprint=0.7, pitch_degrees=12.0)
FIELD = create("turbulent", 1, GRID.extent, GRID.center)


@pytest.mark.parametrize(
    "effects",
    [
        None,
        Effects(absorption=0.03, self_absorption=0.1, gain_spread=0.05),
        Effects(aperture=1.0, focus_distance=60.0, aperture_rays=4),
    ],
    ids=["clear", "gas", "aperture"],
)
def test_images_are_those_of_the_cpu(cupy, effects):
    how = {"supersample": 2, "refine": 2, "effects": effects}
    own = simulate_images(RIG, FIELD, GRID, **how)
    there = simulate_images(RIG, FIELD, GRID, device="cuda", **how)
    assert own.settings["device"] == "computed on the CPU"
    assert there.settings["device"] == "computed on Stand-in (cuda:0)"
    for name, image in own.images.items():
        np.testing.assert_allclose(there.images[name], image, rtol=1e-5, atol=1e-6 * image.max())
    assert np.array_equal(own.truth, there.truth)


def test_auto_leaves_small_scenes_to_the_cpu(cupy):
    own, auto = (simulate_images(RIG, FIELD, GRID, device=device) for device in ("cpu", "auto"))
    assert "a GPU pays from" in auto.settings["device"]
    assert all(np.array_equal(auto.images[name], image) for name, image in own.images.items())


def test_films_are_those_of_the_cpu(cupy, tmp_path):
    for device in ("cpu", "cuda"):
        simulate_film(RIG, FIELD, GRID, tmp_path / device, frames=2, device=device)
    own, there = (load_scan(tmp_path / device) for device in ("cpu", "cuda"))
    for frame in own.frame_names:
        for one, other in zip(own.images(frame), there.images(frame), strict=True):
            np.testing.assert_allclose(other, one, rtol=1e-5, atol=1e-6 * one.max())


def test_too_little_memory_is_said_before_the_work(cupy, monkeypatch):
    monkeypatch.setattr(cupy.cuda.runtime, "memGetInfo", lambda: (1000, 1 << 40))
    with pytest.raises(ValueError, match=r"device: found 'cuda', .* GB free; 0 voxels would fit"):
        simulate_images(RIG, FIELD, GRID, device="cuda")
    with pytest.raises(ValueError, match="device: found 'gpu', expected cpu, auto, cuda or cuda:"):
        simulate_images(RIG, FIELD, GRID, device="gpu")
