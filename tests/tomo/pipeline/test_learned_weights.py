import json

import numpy as np
import pytest

from rigs import ring
from tomo import LinearSystem, VoxelGrid
from tomo.pipeline.learned_weights import LearnedWeights
from tomo.wernet import Encoder, RayFeatures, RayWeights
from tomo.wernet.weights import reweighted

GRID = VoxelGrid((6, 8, 7), (1.0, 1.5, 1.2), (2.0, 0.0, -1.0))
RESIDUALS = {"segment_lengths": 0.1, "learned": 0.05}


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
    scale, gauge = RayFeatures.of(lengths, "optics").image_scale, np.ones(GRID.size, np.float32)
    weights = RayWeights(Encoder(), volume.ravel(), 1.0, scale, gauge)

    def of(ratio, volume=volume):
        learned = reweighted(lengths, ratio.astype(np.float32))
        return LearnedWeights.of(weights, lengths, learned, volume, RESIDUALS)

    return of


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


def test_absorption_is_seen_by_depth(sum_up, attenuated):
    depth = sum_up(attenuated).profiles[0]
    assert (depth.quantity, depth.unit) == ("depth in the grid", "length")
    lit = depth.light > 0.02
    left = depth.weight[lit] / np.exp(-0.1 * depth.centre[lit])  # up to the factor of the mean
    np.testing.assert_allclose(left, left.mean(), rtol=0.01)


def test_shading_is_seen_by_angle(sum_up, system):
    projector = system.projector
    angles = []
    for view, camera in enumerate(system.rig):
        axis = projector.view(view).segments.midpoint - (camera.position - GRID.center)
        cosine = axis @ camera.R[2] / np.linalg.norm(axis, axis=1)
        angles.append(np.degrees(np.arccos(np.clip(cosine, -1, 1))))
    found = sum_up(1 - 0.05 * np.concatenate(angles)).profiles[2]
    assert (found.quantity, found.unit) == ("angle off the image's middle", "degrees")
    lit = found.light > 0.02
    slope, first = np.polyfit(found.centre[lit], found.weight[lit], 1)
    assert slope / first == pytest.approx(-0.05, rel=0.15)


def test_the_bins_hold_all_light_and_average_to_one(sum_up, attenuated, system, volume):
    found = sum_up(attenuated)
    assert [profile.quantity for profile in found.profiles][1] == "upstream emission"
    for profile in found.profiles:
        assert profile.light.sum() == pytest.approx(1)
        dim = ~np.isfinite(profile.weight)
        assert (profile.light[dim] < 1e-3).all()
        mean = np.nansum(profile.light * profile.weight)
        assert mean == pytest.approx(1, rel=2 * profile.light[dim].sum() + 1e-5)
    segments = system.projector.segments
    light = segments.length * volume.ravel()[segments.voxel]
    mean = np.average(attenuated, weights=light)
    variance = np.average((attenuated - mean) ** 2, weights=light)
    assert found.spread == pytest.approx(np.sqrt(variance) / mean, rel=1e-4)


def test_a_common_factor_of_weights_or_emission_says_nothing(sum_up, attenuated, volume):
    first = sum_up(attenuated)
    for other in (sum_up(3 * attenuated), sum_up(attenuated, 50 * volume)):
        assert other.spread == pytest.approx(first.spread, rel=1e-5)
        for one, same in zip(first.profiles, other.profiles, strict=True):
            np.testing.assert_allclose(one.weight, same.weight, rtol=1e-5)


def test_what_no_light_takes_does_not_count(sum_up, attenuated, system, volume):
    hollow = volume.copy()
    hollow[:, :, 3:] = 0
    dark = hollow.ravel()[system.projector.segments.voxel] == 0

    def report_of(ratio, volume):
        return json.dumps(sum_up(ratio, volume).report())

    report = report_of(attenuated, hollow)
    assert report_of(np.where(dark, 7.0, attenuated), hollow) == report
    assert report_of(attenuated, volume) != report
