import numpy as np
import pytest

from tomo.grid import VoxelGrid
from tomo.series import SeriesStore
from tomo.series.solving import SKIPPED, FrameResult

COUNT = 20


@pytest.fixture(scope="session")
def attributes():
    return {
        "cameras": ["left", "right"],
        "length_unit": "mm",
        "value_unit": "counts per mm",
        "time_unit": "s",
        "plan": {},
        "plan_warnings": [],
        "options": {"hold_out": ["right"], "method": "auto"},
        "versions": {"flametomo": "0.1.0"},
    }


@pytest.fixture(scope="session")
def filled(attributes):
    """Return a function: path, volumes and settings to a store of them, without solving."""

    def make(path, volumes, *, rate=100.0, bad=(), **figures):
        grid = VoxelGrid(volumes[0].shape, (0.5, 1.0, 2.0), (1.0, 0.0, -3.0))
        count = len(volumes)
        times, numbers = np.arange(count) / rate, np.arange(count) + 50
        store = SeriesStore.create(path, grid, times, numbers, attributes)
        results = []
        for place, volume in enumerate(volumes):
            if place in bad:
                results.append(SKIPPED)
                continue
            store.write_volume(place, volume)
            own = {
                "relative_residual": 0.1,
                "total_emission": float(volume.sum()),
                "seconds": 0.25,
                "view_residual": {"left": 0.1, "right": 0.2},
                "view_beyond_noise": {"left": 0.02},
                "view_gain": {"left": 1.0, "right": 1.05},
                "psnr": {"right": 31.0},
                "ssim": {"right": 0.95},
            }
            own |= {name: values[place] for name, values in figures.items()}
            results.append(FrameResult(None, None, own))
        store.finish(range(count), results)
        return store

    return make


@pytest.fixture(scope="session")
def volumes():
    """Return frames of a spot that moves along x, as volumes of unequal sides."""
    x, y, z = np.meshgrid(np.arange(7), np.arange(9), np.arange(5), indexing="ij")
    return [
        np.exp(-((x - 0.3 * time) ** 2) / 4 - (y - 4) ** 2 / 6 - (z - 1) ** 2).astype(np.float32)
        for time in range(COUNT)
    ]


@pytest.fixture(scope="session")
def store(filled, volumes, tmp_path_factory):
    """Return a store whose frame 54, in place 4, could not be read."""
    return filled(tmp_path_factory.mktemp("store") / "out.zarr", volumes, bad=(4,))
