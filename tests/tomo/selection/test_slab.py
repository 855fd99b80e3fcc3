import numpy as np
import pytest

import rigs
from tomo import VoxelGrid
from tomo.operators import LinearSystem
from tomo.selection import choose_by_left_out_pixels, folds, solve_as_chosen


@pytest.fixture(scope="module")
def tall():
    """Return a tall flame's equations in the linear basis, its truth and its images."""
    grid = VoxelGrid((14, 40, 14), 1.0)
    rig = rigs.ring(6, distance=300.0, image_size=(40, 96), footprint=0.5)
    x, y, z = np.moveaxis(grid.centers(), -1, 0)
    truth = np.exp(-(((x - 0.7) / 3) ** 2) - (y / 12) ** 2 - ((z + 0.4) / 2.5) ** 2)
    system = LinearSystem.from_rig(rig, grid).with_linear_basis()
    truth = truth.ravel().astype(np.float32)
    measured = (system.projector @ truth).astype(np.float32)
    return system.projector, truth, measured, system.blocks(2.0)


def test_some_unknowns_are_those_of_the_whole_with_the_others_dark(tall):
    projector, truth, *_ = tall
    kept = np.random.default_rng(0).random(len(truth)) < 0.3
    part = projector.of_unknowns(kept)
    assert part.shape == (projector.shape[0], np.count_nonzero(kept))
    np.testing.assert_allclose(
        part @ truth[kept], projector @ np.where(kept, truth, 0), rtol=1e-5, atol=1e-6
    )
    on_the_fly = LinearSystem.from_rig(
        rigs.ring(3, distance=300.0, image_size=(8, 8), footprint=2.0),
        projector.grid,
        form="on-the-fly",
    )
    with pytest.raises(ValueError, match="not stored"):
        on_the_fly.projector.of_unknowns(kept)


def test_a_slab_goes_across_the_axis_that_rays_leave_least(tall, monkeypatch):
    projector, truth, measured, _ = tall
    monkeypatch.setattr(folds, "SEGMENTS", projector.n_segments // 4)
    part = folds.part_to_choose_by(projector, measured)
    own = part.projector.active.mask.any(axis=(0, 2))  # planes across y
    assert part.projector.active.mask[:, own].all()
    assert 0.15 < own.mean() < 0.35
    assert own[len(own) // 2]
    assert part.projector.n_segments < 0.5 * projector.n_segments
    inside = part.projector @ truth[part.projector.active.mask.ravel()]
    missed = np.linalg.norm(inside - part.measured) / np.linalg.norm(measured[part.pixels])
    assert missed < 0.05


def test_a_slab_chooses_nearly_as_the_whole(tall, monkeypatch):
    projector, truth, measured, blocks = tall
    noise = np.random.default_rng(1).standard_normal(len(measured))
    noisy = (measured + 0.05 * measured.max() * noise).astype(np.float32)
    monkeypatch.setattr(folds, "SEGMENTS", projector.n_segments)
    whole = choose_by_left_out_pixels(projector, noisy, blocks=blocks)
    monkeypatch.setattr(folds, "SEGMENTS", projector.n_segments // 3)
    part = choose_by_left_out_pixels(projector, noisy, blocks=blocks)
    errors = [
        np.linalg.norm(solve_as_chosen(projector, noisy, choice).volume.ravel() - truth)
        for choice in (part, whole)
    ]
    assert errors[0] < 1.2 * errors[1]


def test_rays_over_a_pixel_leave_the_slab_as_thick(monkeypatch):
    """Nine rays a pixel: nine times the segments, and no thinner than rays along diagonals."""
    rig = rigs.ring(6, distance=200.0, image_size=(30, 40), footprint=0.6)
    grid = VoxelGrid((16, 24, 16), 1.0)
    one, nine = (LinearSystem.from_rig(rig, grid, supersample=k).projector for k in (1, 3))
    assert nine.n_segments > 8 * one.n_segments
    monkeypatch.setattr(folds, "SEGMENTS", 0.6 * one.n_segments)
    kept = [
        len(folds.part_to_choose_by(projector, projector @ np.ones(grid.size, np.float32)).pixels)
        for projector in (one, nine)
    ]
    assert 0.6 < kept[1] / kept[0] < 1.05
