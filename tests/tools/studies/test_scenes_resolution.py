"""Waves on a blob: their images are those of an independent forward model; the rows add up."""

from dataclasses import dataclass

import numpy as np
import pytest
from studies.scenes import cameras, resolution
from studies.scenes.forward import radiance
from studies.scenes.trial import Trials
from studies.stress.resolution import FACTOR, FINEST, WaveScene

from tomo import LinearSystem, VoxelGrid

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
    rig = cameras.rig("dome-6", waves.grid, resolution.SMALL_IMAGES)
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


def test_rows_are_counted_together(monkeypatch, tmp_path):
    monkeypatch.setattr(resolution, "RIGS", ("dome-6", "ring-8"))
    trials = Trials(tmp_path / "cache", tmp_path / "rows")
    tables = resolution.resolution(
        trials, "settle", quick=True, progress=lambda done, total, name: None
    )
    (overall,), rows, single = tables["overall"], tables["rigs"], tables["directions"]
    assert len(single) == overall["directions"] == 2 * resolution.QUICK_DIRECTIONS
    above = [each for each in single if max(each["predicted"], each["measured"]) > FINEST]
    assert len(above) == overall["above"] == sum(row["above"] for row in rows)
    within = [each for each in above if 1 / FACTOR < each["measured"] / each["predicted"] < FACTOR]
    assert overall["within"] == pytest.approx(len(within) / len(above))
    assert overall["within"] >= 0.8
