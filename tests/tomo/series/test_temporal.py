"""Frames filtered in time: weights from left-out views, motion, and that blocks stay alone."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.ndimage import shift

import rigs
from tomo import Options, Scan, VoxelGrid, metrics
from tomo.grid import ActiveVoxels
from tomo.operators import LinearSystem
from tomo.series import make_plan, reconstruct_series
from tomo.series.frames import reader_of
from tomo.series.run import solve_block
from tomo.series.temporal import REACH, TemporalFilter, moved, with_neighbours

pytestmark = pytest.mark.usefixtures("quick_choices")

GRID = VoxelGrid((10, 12, 10), 1.0)
RIG = rigs.ring(5, distance=200.0, image_size=(20, 22), footprint=0.8, pitch_degrees=12.0)
COUNT = 8  # a block
FASTEST = 0.35  # voxels a frame
QUICK = Options(
    frames=":", key_frames=1, screen=False, fit_gain=False, fit_absorption=False,
    basis="voxel", refine_cameras=("none",),
)  # fmt: skip


def blobs(seed, rise=0.0):
    """Return fourteen blobs at places of a seed, moved up by some voxels."""
    rng = np.random.default_rng(seed)
    x, y, z = np.moveaxis(GRID.centers(), -1, 0)
    volume = np.zeros(GRID.shape)
    for cx, cy, cz in rng.uniform((-3, -5, -3), (3, 1, 3), (14, 3)):
        volume += np.exp(-((x - cx) ** 2 + (y - cy - rise) ** 2 + (z - cz) ** 2) / 1.2)
    return np.where(volume > 0.02, volume, 0).astype(np.float32)


def film_of(truths, noise=0.5):
    system = LinearSystem.from_rig(RIG, GRID, skip=False)
    rng = np.random.default_rng(7)
    images = {name: [] for name in RIG.names}
    for truth in truths:
        clean = system.images(system.projector @ truth.ravel())
        for name, image in zip(RIG.names, clean, strict=True):
            images[name].append(image + rng.normal(0, noise, image.shape).astype(np.float32))
    return Scan.from_arrays(RIG, {name: np.array(each) for name, each in images.items()}, GRID)


def plan_of(truths):
    """Return the plan of a film, with the filter that is found for it."""
    return make_plan(film_of(truths), GRID, QUICK, tuple(range(len(truths))))


def error_of(plan, truths):
    read, places = reader_of(plan.scan, plan.screened), range(len(truths))
    found = solve_block(plan, places, [read(place) for place in places])
    return np.mean([metrics.nrmse(result.volume, truths[place]) for place, result in found])


def test_frames_of_a_moving_film_gain_by_their_neighbours():
    truths = [blobs(1, FASTEST * time) for time in range(COUNT)]
    plan = plan_of(truths)
    chosen = plan.report()["temporal"]
    assert error_of(plan, truths) < 0.85 * error_of(replace(plan, temporal=None), truths)
    assert chosen["held_out_residual"] < chosen["held_out_residual_alone"]
    np.testing.assert_allclose(chosen["filter"]["velocity"], [0, FASTEST, 0], atol=0.15)


def test_unrelated_frames_stand_alone():
    plan = plan_of([blobs(10 + time) for time in range(COUNT)])
    chosen = plan.report()["temporal"]
    assert plan.filter is chosen["filter"] is None
    assert "no better" in chosen["reason"]


def test_a_block_alone_has_the_bits_of_the_series(tmp_path, monkeypatch):
    scan = film_of([blobs(1, 0.2 * time) for time in range(11)])
    options = replace(QUICK, temporal=1.0)
    plan = make_plan(scan, GRID, options, tuple(range(11)))
    monkeypatch.setattr("tomo.series.run.make_plan", lambda *_: plan)
    store = reconstruct_series(scan, tmp_path / "out.zarr", options=options)
    read = reader_of(plan.scan, plan.screened)
    frames = [read(place) for place in plan.solved_with(range(8, 11))]
    assert len(frames) == 3 + REACH
    found = dict(solve_block(plan, range(8, 11), frames))
    assert sorted(found) == [8, 9, 10]
    for place, result in found.items():
        np.testing.assert_array_equal(result.volume, store.volume(place))


def test_a_steady_film_keeps_its_frames_up_to_its_ends():
    active = ActiveVoxels(GRID)
    frames = dict.fromkeys(range(3), blobs(4).ravel())
    for place in range(3):
        mean = TemporalFilter.gaussian(1.0).apply(active, frames, place)
        np.testing.assert_allclose(mean, frames[0], atol=1e-6)


def test_frames_are_brought_to_the_time_of_one_before_they_are_added():
    active = ActiveVoxels(GRID)
    frames = {time: blobs(1, FASTEST * time).ravel() for time in range(5)}
    mean = TemporalFilter.gaussian(2.0)
    carried = TemporalFilter(mean.coarse, mean.fine, (0.0, FASTEST, 0.0))
    error = [metrics.nrmse(one.apply(active, frames, 2), frames[2]) for one in (mean, carried)]
    assert error[1] < 0.5 * error[0]


@pytest.mark.parametrize("move", [(0.3, 0, 0), (0, -1.6, 0.25), (0, 0, 14.0)])
def test_volumes_move_as_smooth_fields_do(move):
    volume = blobs(2)
    found = moved(ActiveVoxels(GRID), volume.ravel(), np.array(move)).reshape(GRID.shape)
    expected = shift(volume, move, order=3, mode="constant")
    np.testing.assert_allclose(found, expected, atol=0.06 * volume.max())


def test_neighbours_stay_inside_the_series():
    assert with_neighbours(range(0, 8), 11) == range(0, 8 + REACH)
    assert with_neighbours(range(8, 11), 11) == range(8 - REACH, 11)


def test_a_strength_needs_the_choice_of_smoothness(tmp_path):
    scan = film_of([blobs(1)] * 2)
    options = Options(frames=":", temporal=1.0, method="mlem")
    with pytest.raises(ValueError, match="temporal: found 1 with"):
        reconstruct_series(scan, tmp_path / "out.zarr", options=options)
