"""What check-rig says of windows and hardware, against closed forms and areas."""

import math

import numpy as np
import pytest

from rigs import Camera, Rig, Volume, box_points, look_at
from rigs.check import check_points
from rigs.check.through_scene import hidden_pixels, shift_at
from rigs.scene import Cylinder, Glass, Mirror, Opaque, Reflecting, Scene, SceneCamera, Window
from rigs.scene.gas import Gas, IndexVolume

POINTS = box_points((-5, -5, -5), (5, 5, 5), 5)
EVERYWHERE = np.zeros(3)


def camera(position=(0.0, 0, 300), name="cam00", size=60):
    R, t = look_at(position, (0, 0, 0))
    middle = (size - 1) / 2
    K = [[25 * size, 0, middle], [0, 25 * size, middle], [0, 0, 1]]
    return Camera(name, (size, size), K, R=R, t=t)


def pane(degrees, index=1.4585, size=None):
    angle = math.radians(degrees)
    return Window(
        "pane", (0, 0, 60), (math.sin(angle), 0, math.cos(angle)), 10, Glass(index), size=size
    )


def plate_shift(degrees, index, thickness=10):
    """Jenkins and White, "Fundamentals of Optics", chapter 2."""
    angle = math.radians(degrees)
    sine = math.sin(angle)
    return thickness * sine * (1 - math.cos(angle) / math.sqrt(index**2 - sine**2))


@pytest.mark.parametrize("degrees", [0, 15, 30])
def test_the_shift_and_the_angle_are_those_of_a_plate(degrees):
    """The ray through the middle is tilted by 0.36 degrees, which changes the shift by 0.027."""
    found = shift_at(SceneCamera(camera(), Scene((pane(degrees),))), EVERYWHERE)
    assert found.length == pytest.approx(plate_shift(degrees, 1.4585), abs=0.03)
    assert found.angle == pytest.approx(degrees, abs=0.4)


def test_gas_on_the_way_is_not_taken_for_a_solid():
    """The rod, which is not on the way, is the last solid; gas pieces end at none."""
    even = IndexVolume(np.full((4, 4, 4), 1.0), (-15, -15, -15), 7.5, 1.0)
    rod = Window("aside", (900, 0, 0), (1, 0, 0), 5, Glass(1.5), size=4)
    seen = SceneCamera(camera(), Scene((rod,), gas=Gas(even)))
    assert shift_at(seen, EVERYWHERE) is None


def test_gas_that_the_box_cuts_is_a_warning():
    values = np.ones((6, 6, 6))
    values[2:4, 2:4, 2:] = 1.0003
    scene = Scene(gas=Gas(IndexVolume(values, (-15, -15, -15), 5.0, 1.0)))
    cameras = (camera(size=12), camera((300.0, 0, 0), "cam01", size=12))
    check = check_points(Rig(cameras).through(scene), POINTS, (10, 10, 10), 1.0)
    (found,) = (one for one in check.findings if "index volume" in one.text)
    assert found.level == "warning"
    assert "upper z (100%)" in found.text


def test_the_shift_by_colour_is_that_of_the_glass_at_both_ends_of_the_band():
    """Fused quartz, Malitson 1965: 1.46557 at 450 nm, 1.45529 at 700 nm."""
    found = shift_at(SceneCamera(camera(), Scene((pane(30),))), EVERYWHERE)
    wanted = plate_shift(30, 1.46557) - plate_shift(30, 1.45529)
    assert found.by_colour == pytest.approx(wanted, rel=0.2)  # crown glass in general


def test_hidden_pixels_are_the_shadow_of_a_rod():
    """A rod of 2 half way, before a box that fills 33 of 60 columns: 4 wide in the image's 12."""
    rod = Cylinder("rod", (0, 0, 150), (0, 1, 0), 1, 50, Opaque())
    share, seen = hidden_pixels(SceneCamera(camera(), Scene((rod,))), POINTS)
    assert share == pytest.approx(2 / 150 * 1500 / 60, abs=0.03)
    assert set(seen) == {"rod"}


def test_findings_name_glass_and_hardware_and_are_silent_without():
    cameras = tuple(camera((300 * math.sin(a), 20, 300 * math.cos(a)), f"cam{n:02d}")
                    for n, a in enumerate((0, 0.8, 1.7, 2.5)))  # fmt: skip
    plain = Rig(cameras, volume=Volume((10, 10, 10), 1.0))
    rod = Cylinder("rod", (2, 0, 150), (0, 1, 0), 1, 50, Opaque())
    mirror = Mirror("far", (0, 0, -200), (0, 0, 1), Reflecting(), size=5)
    seen = plain.through(Scene((pane(30, size=40), rod, mirror)))
    texts = [finding.text for finding in check_points(seen, POINTS, (10, 10, 10), 1.0).findings]
    assert any("hardware (rod" in text for text in texts)
    assert any("shifts lines of sight by up to 1.9 mm" in text for text in texts), texts
    texts = [finding.text for finding in check_points(plain, POINTS, (10, 10, 10), 1.0).findings]
    assert not any("hardware" in text or "glass" in text for text in texts)
