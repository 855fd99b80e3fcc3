"""Frames are found by their names, or by the end of them where only one is meant."""

import pytest

from rigs import ring
from tomo.scan import Frame, Scan


def scan_of(*names):
    rig = ring(1, image_size=(2, 2), footprint=1.0)
    return Scan(rig, tuple(Frame(name, {}) for name in names))


@pytest.mark.parametrize(
    ("names", "asked", "found"),
    [
        (("frame_060", "frame_090"), "90", "frame_090"),
        (("frame_060", "frame_090"), "090", "frame_090"),
        (("frame_060", "frame_090"), "frame_060", "frame_060"),
        (("frame_060", "frame_090"), None, "frame_060"),
        (("0", "10"), "0", "0"),
        (("frame_9", "frame_19"), "9", "frame_9"),
        (("bright", "dark"), "right", "bright"),
    ],
)
def test_one_frame_is_meant(names, asked, found):
    assert scan_of(*names).frame(asked).name == found


@pytest.mark.parametrize(
    ("names", "asked"), [(("a_09", "b_9"), "9"), (("a1", "a2"), "3"), (("a", "b"), "")]
)
def test_no_frame_or_more_than_one_is_meant(names, asked):
    with pytest.raises(ValueError, match=f"frame: found '{asked}', expected one of {names[0]}, "):
        scan_of(*names).frame(asked)
