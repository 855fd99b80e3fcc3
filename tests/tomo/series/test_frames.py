import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import rigs
from tomo import Scan
from tomo.series import choose_frames
from tomo.series.frames import BLOCK, blocks_of, slices_of, spread


@pytest.fixture(scope="module")
def scan():
    rig = rigs.ring(2, distance=50.0, image_size=(2, 2), footprint=1.0)
    return Scan.from_arrays(rig, {name: np.ones((10, 2, 2)) for name in rig.names})


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        (":", range(10)),
        ("0:10:3", [0, 3, 6, 9]),
        ("::4", [0, 4, 8]),
        ("-3:", [7, 8, 9]),
        ("2:4, 7:8", [2, 3, 7]),
        ("frame_003,frame_001", [1, 3]),
        ("5", [5]),
        ("0:2,frame_009", [0, 1, 9]),
    ],
)
def test_slices_and_names_choose_frames(scan, text, expected):
    assert choose_frames(scan, text) == tuple(expected)


@pytest.mark.parametrize(
    ("text", "part"),
    [
        ("0:11", "numbers up to 10"),
        ("4:4", "holds none of 10"),
        ("0:5:0", "step 0"),
        ("0:3,2:5", "twice"),
        ("nothing", "expected one of frame_000"),
        ("", "frame"),
        ("0:5:-1", "expected one of"),
    ],
)
def test_what_is_no_frame_is_refused_in_one_line(scan, text, part):
    with pytest.raises(ValueError, match="frame") as caught:
        choose_frames(scan, text)
    assert part in str(caught.value)
    assert "\n" not in str(caught.value)


@given(st.integers(1, 300), st.integers(-320, 320), st.integers(-320, 320), st.integers(1, 40))
def test_slices_are_those_of_python_or_refused(count, start, stop, step):
    expected = tuple(range(count))[start:stop:step]
    try:
        found = slices_of(f"{start}:{stop}:{step}", count)
    except ValueError:
        assert not expected or max(abs(start), abs(stop)) > count
    else:
        assert found == expected


@given(st.text(max_size=30) | st.from_regex(r"[-0-9:, ]{0,20}", fullmatch=True))
def test_any_text_is_read_or_refused(text):
    try:
        found = slices_of(text, 20)
    except ValueError:
        return
    assert set(found) <= set(range(20))


@given(st.integers(1, 1000))
def test_blocks_cover_every_frame_once_and_hold_their_keys(count):
    blocks = blocks_of(count)
    assert [place for block in blocks for place in block] == list(range(count))
    assert all(len(block) <= BLOCK for block in blocks)


@given(st.integers(1, 1000), st.integers(1, 50))
def test_key_frames_are_spread_and_differ(count, wanted):
    found = spread(count, wanted)
    assert len(set(found)) == len(found) == min(count, wanted)
    gaps = np.diff([-found[0] - 1, *found, 2 * count - 1 - found[-1]])
    assert gaps.max() - gaps.min() <= 2
