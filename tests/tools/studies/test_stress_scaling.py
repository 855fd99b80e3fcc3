"""The stress of scaling: its rows hold, and would not if a length or an intensity were fixed."""

from dataclasses import replace
from functools import partial

import numpy as np
import pytest
from studies.stress import scaling
from studies.stress.scaling import Scaled
from studies.stress.scene import scene


@pytest.fixture(scope="module")
def plain():
    return Scaled(scene(noise=0.02).simulated)


@pytest.fixture(scope="module")
def others(plain):
    return [replace(plain, lengths=2.9e5), replace(plain, intensities=3.7e-6)]


def test_a_scaled_scene_has_the_same_rays_with_other_lengths(plain):
    larger = replace(plain, lengths=3.0)
    first, second = plain.seen.stored, larger.seen.stored
    assert first.n_segments == second.n_segments
    np.testing.assert_allclose(second.row_sums, 3 * first.row_sums, rtol=1e-6)


def test_rows_of_the_default_hold(plain, monkeypatch, as_given):
    quick = partial(scaling.reconstructed, **as_given)  # test_hard_scans scales the whole default
    monkeypatch.setattr(scaling, "reconstructed", quick)
    both = replace(plain, lengths=2.9e5, intensities=3.7e-6)
    found = list(scaling._default(plain, [both]))
    assert len(found) == 3
    assert all(row.holds for row in found)


def test_rows_of_solvers_hold_and_a_fixed_length_shows(plain, others, monkeypatch):
    monkeypatch.setattr(scaling.solvers, "METHODS", ("nnls",))
    assert all(row.holds for row in scaling._solvers(plain, others, True))
    run = scaling.solved

    def damped(method, projector, measured):  # by a fixed length: right in one unit alone
        found = run(method, projector, measured)
        return replace(found, volume=found.volume / (1 + 1 / projector.column_sums.max()))

    monkeypatch.setattr(scaling, "solved", damped)
    lengths, intensities = scaling._solvers(plain, others, True)
    assert not lengths.holds
    assert intensities.holds
