"""The stress of the condition report: its rows hold, and would not if its figures were wrong."""

from dataclasses import replace

import numpy as np
import pytest
from studies.stress import trust
from studies.stress.trust_scenes import trust_scene

SMALL = {"shape": (10, 46, 10), "spacing": 1.5, "shrink": 4}


@pytest.fixture(scope="module")
def scene():
    return trust_scene("jet", 11, "gaussian", 5, **SMALL)


@pytest.fixture(scope="module")
def found(scene):
    return trust.assessed(scene, 24)


def rows_of(scene, found):
    return list(trust.deviation_rows(scene, found, 12))


def test_the_deviations_of_emitting_voxels_hold(scene, found):
    emitting, everywhere = rows_of(scene, found)
    assert emitting.holds
    assert emitting.figure >= everywhere.figure


@pytest.mark.parametrize("factor", [0.5, 2.0])
def test_deviations_that_are_wrong_show(scene, found, factor):
    deviations = replace(found.deviations, values=factor * found.deviations.values)
    assert not rows_of(scene, replace(found, deviations=deviations))[0].holds


def test_noise_that_is_wrong_shows(scene, found):
    right = trust.noise_ratio(scene, found)
    deviations = replace(found.deviations, noise=2 * found.deviations.noise)
    assert right == pytest.approx(1, abs=0.15)
    doubled = trust.noise_ratio(scene, replace(found, deviations=deviations))
    assert doubled == pytest.approx(2 * right)


def test_the_resolution_stated_is_measured_and_a_wrong_one_shows(scene, found):
    assert trust.resolution_row(scene, found).holds
    wide = replace(found.resolution, widths=2 * found.resolution.widths)
    assert not trust.resolution_row(scene, replace(found, resolution=wide)).holds


def test_the_warnings_come_where_they_should():
    clean = trust_scene("jet", 33, "clean", 5, **SMALL)
    two, fan, all_views = trust.warning_rows(clean)
    assert two.holds
    assert "few directions" in two.note
    assert fan.holds
    assert "few directions" in fan.note
    assert all_views.holds


def test_two_that_agree_are_within_the_factor_both_ways():
    values, all_voxels = np.array([1.0, 1.0, 1.0, 0.0]), np.ones(4, bool)
    others = np.array([1.4, 1.6, 0.6, 0.0])
    assert trust.agreeing(values, others, all_voxels) == 0.5
    assert trust.agreeing(others, values, all_voxels) == 0.5
