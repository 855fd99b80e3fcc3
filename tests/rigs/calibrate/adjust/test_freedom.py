"""Free numbers of cameras and those that are one, against sums over what they move."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from rigs.calibrate.adjust.freedom import Freedom


@st.composite
def freedoms(draw):
    """Return a freedom of some cameras, all lenses of one length."""
    cameras, size = draw(st.integers(1, 4)), draw(st.integers(4, 9))
    lens = np.array(draw(st.lists(st.booleans(), min_size=size, max_size=size)))
    square = draw(st.booleans())
    if square:
        lens[1] = lens[0]
    common = draw(st.none() | st.just(tuple([0] * cameras)))
    return Freedom(
        (lens,) * cameras,
        np.array(draw(st.lists(st.booleans(), min_size=cameras, max_size=cameras))),
        np.array(draw(st.lists(st.booleans(), min_size=cameras, max_size=cameras))),
        square,
        common,
    )


@given(freedoms(), st.integers(0, 2**31))
def test_derivatives_by_parameters_are_those_along_their_steps(freedom, seed):
    rng = np.random.default_rng(seed)
    change = rng.standard_normal(freedom.size)
    moved = np.zeros(freedom.size, bool)
    for camera, lens in enumerate(freedom.lens):
        by_camera = rng.standard_normal((5, 2, 7 + len(lens)))
        own, by_parameter = freedom.gathered(camera, by_camera)
        moved[own] = True
        step = freedom.step(camera, change)
        assert by_camera @ step == pytest.approx(by_parameter @ change[own])
        held = np.r_[np.repeat(~freedom.pose[camera], 6), ~lens, not freedom.time[camera]]
        assert not step[held].any()
        if freedom.square:
            assert step[6] == step[7]
        if freedom.common is not None:
            assert np.array_equal(step[6:-1], freedom.step(0, change)[6:-1])
    assert moved.all()
    assert freedom.freed_in(freedom).all()


def test_shorter_lenses_are_parts_of_longer_ones():
    wide = Freedom((np.ones(9, bool),), np.ones(1, bool), np.ones(1, bool))
    inner = Freedom((np.arange(6) != 2,), np.ones(1, bool), np.ones(1, bool))
    names = np.r_[np.ones(6, bool), np.arange(6) != 2, np.zeros(3, bool), True]
    assert np.array_equal(wide.freed_in(inner), names)
