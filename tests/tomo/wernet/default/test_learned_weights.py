import json
from dataclasses import replace

import numpy as np
import pytest

from rigs import ring
from tomo import LinearSystem, VoxelGrid
from tomo.wernet.default import (
    CorrectionEncoder,
    LearnedWeights,
    RayFeatures,
    RayWeights,
    ViewParameters,
)
from tomo.wernet.default.ray_weights import reweighted

GRID = VoxelGrid((6, 8, 7), (1.0, 1.5, 1.2), (2.0, 0.0, -1.0))
GAINS = np.array([0.8, 1.1, 1.0, 1.3, 0.9])


@pytest.fixture(scope="module")
def system():
    rig = ring(
        5,
        distance=60.0,
        image_size=(16, 24),
        footprint=0.6,
        center=GRID.center,
        pitch_degrees=[20.0, -20.0, 5.0, 0.0, -10.0],
    )
    return LinearSystem.from_rig(rig, GRID, midpoints=True)


@pytest.fixture(scope="module")
def volume():
    return np.random.default_rng(1).random(GRID.shape).astype(np.float32)


@pytest.fixture(scope="module")
def sum_up(system, volume):
    """Return a function that sums up weights of these relative sizes ``(S,)``."""
    lengths = system.projector
    weights = RayWeights(CorrectionEncoder(), ViewParameters(5, 16), volume.ravel(), 1.0, True)

    def of(ratio, volume=volume, **more):
        learned = reweighted(lengths, np.sqrt(ratio).astype(np.float32) - 1)
        return LearnedWeights.of(weights, lengths, learned, volume, system.rig.names, **more)

    return of


@pytest.fixture(scope="module")
def of_views(system):
    segments = system.projector.segments
    view = np.repeat(np.arange(5), np.diff(system.projector.view_ptr))
    return np.repeat(GAINS[view], np.diff(segments.ptr))


@pytest.fixture(scope="module")
def attenuated(system):
    """Return what remains after a path through gas that absorbs evenly, by the rays' geometry."""
    projector = system.projector
    segments = projector.segments
    half = np.asarray(GRID.extent) / 2
    left = []
    for view, camera in enumerate(system.rig):
        part = projector.view(view).segments
        origin = camera.position - GRID.center
        way = part.midpoint.astype(np.float64) - origin
        reach = np.linalg.norm(way, axis=1)
        enter = ((-np.sign(way) * half - origin) / (way / reach[:, None])).max(axis=1)
        left.append(np.exp(-0.1 * (reach - enter)))
    assert sum(map(len, left)) == len(segments)
    return np.concatenate(left)


def test_gains_are_found_by_camera_and_nowhere_else(sum_up, of_views, system, volume):
    found = sum_up(of_views, held_out_residual={"segment_lengths": 0.1, "learned": 0.05})
    np.testing.assert_allclose(found.by_camera, GAINS, rtol=1e-5)
    assert found.cameras == system.rig.names
    segments = system.projector.segments
    light = segments.length * volume.ravel()[segments.voxel]
    mean = np.average(of_views, weights=light)
    assert found.mean == pytest.approx(mean, rel=1e-5)
    variance = np.average((of_views - mean) ** 2, weights=light)
    assert found.spread == pytest.approx(np.sqrt(variance) / mean, rel=1e-4)
    assert found.true_by_camera is None
    assert found.explained is None


def test_the_bins_hold_all_light_and_average_to_the_mean(sum_up, of_views, attenuated):
    found = sum_up(of_views * attenuated)
    assert len(found.profiles) == 6
    for profile in found.profiles:
        assert profile.light.sum() == pytest.approx(1)
        dim = ~np.isfinite(profile.weight)
        assert (profile.light[dim] < 1e-3).all()
        mean = np.nansum(profile.light * profile.weight)
        assert mean == pytest.approx(found.mean, rel=2 * profile.light[dim].sum() + 1e-5)


def test_absorption_is_seen_by_depth(sum_up, attenuated):
    depth = sum_up(attenuated).profiles[0]
    assert (depth.quantity, depth.unit) == ("depth in the grid", "length")
    lit = depth.light > 0.02
    np.testing.assert_allclose(depth.weight[lit], np.exp(-0.1 * depth.centre[lit]), rtol=0.01)


def test_position_in_the_voxel_is_from_half_a_voxel_below_to_half_above(sum_up, system):
    segments = system.projector.segments
    index = np.stack(np.unravel_index(segments.voxel, GRID.shape), axis=1)
    centre = (index - (np.array(GRID.shape) - 1) / 2) * GRID.spacing
    position = (segments.midpoint - centre) / GRID.spacing  # (S, 3)
    found = sum_up(1 + 0.5 * position[:, 2])
    profile = found.profiles[-1]
    assert profile.quantity == "position in the voxel, z"
    np.testing.assert_allclose(profile.edges[[0, -1]], [-0.5, 0.5])
    lit = profile.light > 0.01
    np.testing.assert_allclose(profile.weight[lit], 1 + 0.5 * profile.centre[lit], atol=0.02)


def test_what_no_light_takes_does_not_count(sum_up, attenuated, system, volume):
    hollow = volume.copy()
    hollow[:, :, 3:] = 0
    dark = hollow.ravel()[system.projector.segments.voxel] == 0

    def report_of(ratio, volume):
        return json.dumps(sum_up(ratio, volume).report())

    report = report_of(attenuated, hollow)
    assert report_of(np.where(dark, 7.0, attenuated), hollow) == report
    assert report_of(attenuated, volume) != report


def test_a_common_factor_of_the_truth_says_nothing(sum_up, of_views, attenuated):
    ratio = of_views * attenuated
    found = sum_up(ratio, truth=3 * ratio)
    assert found.explained == pytest.approx(1, abs=1e-9)
    np.testing.assert_allclose(found.true_by_camera, found.by_camera, rtol=1e-5)
    for profile in found.profiles:
        np.testing.assert_allclose(profile.truth, profile.weight, rtol=1e-5)
    lengths = np.ones_like(ratio)
    assert sum_up(lengths, truth=ratio).explained == pytest.approx(0, abs=1e-9)
    part = sum_up(attenuated, truth=ratio).explained
    assert 0.2 < part < 0.9
    assert sum_up(1 / ratio, truth=ratio).explained < 0
    assert sum_up(ratio, truth=lengths).explained is None  # there was nothing to learn


def test_the_report_is_plain(sum_up, of_views, attenuated):
    found = sum_up(attenuated, truth=of_views, held_out_residual={"segment_lengths": 0.1})
    report = json.loads(json.dumps(found.report()))
    assert list(report["cameras"]) == list(found.cameras)
    assert report["held_out_residual"] == {"segment_lengths": 0.1}
    assert report["explained"] == found.explained
    column = report["profiles"]["upstream emission"]
    assert len(column["centre"]) == len(column["truth"]) == len(column["weight"])
    assert "LearnedWeights: 5 cameras" in repr(found)


def test_some_rays_stand_for_many_segments(sum_up, of_views, attenuated, monkeypatch):
    from tomo.wernet.default import learned_weights

    whole = sum_up(of_views * attenuated)
    monkeypatch.setattr(learned_weights, "MOST_SEGMENTS", 4000)
    some = sum_up(of_views * attenuated)
    assert some.mean != whole.mean
    assert some.mean == pytest.approx(whole.mean, rel=0.03)
    np.testing.assert_allclose(some.by_camera, whole.by_camera, rtol=0.05)


def test_what_does_not_fit_is_refused(sum_up, attenuated, system, volume):
    with pytest.raises(ValueError, match="truth: found 3 segments, expected"):
        sum_up(attenuated, truth=np.ones(3))
    lengths = system.projector
    weights = RayWeights(CorrectionEncoder(), ViewParameters(5, 16), volume.ravel(), 1.0, True)
    with pytest.raises(ValueError, match="cameras: found 1 names, expected 5"):
        LearnedWeights.of(weights, lengths, lengths, volume, ["a"])
    part = lengths.view(0)
    with pytest.raises(ValueError, match="learned: found"):
        LearnedWeights.of(weights, lengths, part, volume, system.rig.names)


def test_directions_are_those_of_the_view_s_own_rays():
    """A pixel that crosses one voxel has the direction of a near one, but of no other camera."""
    rig = ring(2, 180.0, 300.0, image_size=(30, 30), footprint=0.5, pitch_degrees=[40.0, -40.0])
    system = LinearSystem.from_rig(rig, VoxelGrid((8, 8, 8), 1.0), midpoints=True)
    features = RayFeatures.of(system.projector)
    ptr = system.projector.view_ptr
    for camera, (start, stop) in zip(rig, np.stack([ptr[:-1], ptr[1:]], axis=1), strict=True):
        cosine = features.direction.numpy()[start:stop] @ camera.R[2]
        assert cosine.min() > 0.999
    assert (features.count == 1).any()
    assert np.abs(features.image_position.numpy()).max() == pytest.approx(1)
    assert np.quantile(np.abs(features.image_position.numpy()), 0.9) > 0.5


def test_sizes_do_not_hang_on_the_scale_of_the_emission(sum_up, attenuated, volume):
    first = sum_up(attenuated)
    scaled = sum_up(attenuated, 50 * volume)
    assert scaled.mean == pytest.approx(first.mean, rel=1e-6)
    assert replace(scaled, profiles=()).spread == pytest.approx(first.spread, rel=1e-5)
