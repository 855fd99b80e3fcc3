"""Waves come back from six rigs down to the wavelengths that the criterion predicts."""

from dataclasses import dataclass, replace

import numpy as np
import pytest
from studies.scenes import cameras
from studies.scenes.forward import radiance
from studies.stress import resolution
from studies.stress.resolution import WaveScene

from rigs.check.resolved_wavelength import half_sphere
from tomo import LinearSystem, VoxelGrid

DIRECTIONS = half_sphere(8)


@pytest.fixture(scope="module")
def scenes():
    rigs = resolution.six_rigs(resolution.QUICK_SIDE)
    assert len(rigs) == 6
    return {name: resolution.WaveScene.of(rigs[name], 16) for name in ("ring of 5", "ring of 8")}


@pytest.mark.parametrize("name", ["ring of 5", "ring of 8"])
def test_waves_come_back_down_to_what_is_predicted(scenes, name):
    row = resolution.wave_row(name, scenes[name], DIRECTIONS)
    assert row.holds, row.note


def test_a_criterion_twice_as_coarse_or_as_fine_would_show(scenes):
    scene = scenes["ring of 5"]
    for factor in (0.4, 2.5):
        wrong = replace(scene)
        object.__setattr__(wrong, "predicted", lambda n, f=factor: f * scene.predicted(n))
        assert not resolution.wave_row("wrong", wrong, DIRECTIONS).holds


def test_waves_across_a_view_come_back_and_those_along_all_views_do_not(scenes):
    scene = scenes["ring of 5"]
    up = np.array([0.0, 1.0, 0.0])
    assert scene.returned(up, 3.0) > 0.85  # every camera looks across it
    assert scene.measured(up) == resolution.FINEST
    upright = np.radians(np.arange(0.0, 180.0, 3.0))
    level = np.stack([np.sin(upright), 0 * upright, np.cos(upright)], axis=-1)
    predicted = scene.predicted(level)
    assert scene.returned(level[predicted.argmax()], 3.0) < 0.4  # between two of them
    assert scene.returned(level[predicted.argmin()], 3.0) > 0.7


SIDE = 16
GRID = VoxelGrid((SIDE,) * 3, 1.0)


@dataclass(frozen=True)
class Waves:
    """The blob of `WaveScene`, modulated by a plane wave between zero and two."""

    direction: tuple[float, float, float]
    wavelength: float
    grid: VoxelGrid = GRID

    @property
    def reach(self):
        return self.grid.lower, self.grid.upper

    def __call__(self, points):
        radius = np.linalg.norm(points, axis=-1) / (SIDE / 2)
        blob = np.cos(np.pi / 2 * np.clip((radius - 0.55) / 0.4, 0, 1)) ** 2
        return blob * (1 + np.cos(2 * np.pi / self.wavelength * (points @ self.direction)))


@pytest.mark.parametrize(("wavelength", "most"), [(8.0, 0.05), (4.0, 0.05)])
def test_images_of_waves_are_those_of_dense_sampling(wavelength, most):
    waves, blob = Waves((0.6, 0.64, 0.48), wavelength), Waves((0.0, 0.0, 0.0), wavelength)
    rig = cameras.rig("dome-6", waves.grid, 3)
    scene = WaveScene.of(rig, SIDE)
    system = LinearSystem.from_rig(rig, scene.fine, skip=False)
    found = system.projector @ waves(scene.fine.centers().reshape(-1, 3)).astype(np.float32)
    expected, plain = (
        np.concatenate([
            radiance(camera, field).ravel()[pixels]
            for camera, pixels in zip(rig, system.pixels, strict=True)
        ])
        for field in (waves, blob)
    )  # fmt: skip
    wave = expected - plain / 2
    assert np.linalg.norm(found - expected) < most * np.linalg.norm(wave)
