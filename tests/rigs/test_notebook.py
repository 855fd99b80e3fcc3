"""What notebooks show of a rig: a drawing that is right, and small HTML that loads nothing."""

import re
from dataclasses import replace
from xml.etree import ElementTree

import numpy as np
import pytest

from rigs import Rig, Volume, as_ray_tables, look_at, preset, ring
from rigs.notebook import HEIGHT, WIDTH, facts, framed, upward
from rigs.scene import Glass, Scene, Window

BOX = Volume((4, 10, 4), 1.0)
RIG = ring(4, distance=100.0, image_size=(30, 40), footprint=0.5, volume=BOX)


def views(html):
    """Return the drawings, from above and from the side."""
    return [ElementTree.fromstring(one) for one in re.findall(r"<svg.*?</svg>", html)]


def places(svg):
    """Return where each camera stands in a drawing, by its name."""
    return {
        group.find("title").text: np.array(
            [float(group.find("circle").get(name)) for name in ("cx", "cy")]
        )
        for group in svg.iter("g")
    }


def test_cameras_stand_round_the_volume_as_seen_from_above():
    above, side = views(RIG._repr_html_())
    at = places(above)
    # y is up: z to the right and x up the page; cam00 on the +z side, cam01 on the +x side
    middle = np.array([WIDTH / 2, HEIGHT / 2])
    toward = {name: np.sign(np.round(point - middle, 3)).tolist() for name, point in at.items()}
    assert toward == {"cam00": [1, 0], "cam01": [0, -1], "cam02": [-1, 0], "cam03": [0, 1]}
    assert np.ptp([point[1] for point in places(side).values()]) == pytest.approx(0)
    assert all(((point > 0) & (point < [WIDTH, HEIGHT])).all() for point in at.values())


def test_a_camera_above_is_above_in_the_view_from_the_side():
    R, t = look_at((0, 90, 40), (0, 0, 0), (0, 1, 0))
    high = replace(RIG["cam00"], name="high", R=R, t=t)
    side = places(views(Rig((*RIG.cameras, high), volume=BOX)._repr_html_())[1])
    assert side["high"][1] < side["cam00"][1] - 20


def test_the_upward_axis_follows_the_images():
    assert upward(RIG) == (1, 1)
    turned = RIG.transformed([[1, 0, 0], [0, 0, -1], [0, 1, 0]], [0, 0, 0])
    assert upward(turned) == (2, 1)
    assert upward(RIG.transformed(np.diag([1.0, -1.0, -1.0]), [0, 0, 0])) == (1, -1)


@pytest.mark.parametrize(
    "rig",
    [
        Rig(()),
        RIG[:1],
        Rig(RIG.cameras),
        preset("paper33_pitch"),
        as_ray_tables(RIG[:2]),
        RIG.through(Scene([Window("pane", (0, 0, 40), (0, 0, 1), 5, Glass("quartz"), size=30)])),
    ],
    ids=["none", "one", "no volume", "33", "ray tables", "window"],
)
def test_any_rig_is_small_html_that_loads_nothing(rig):
    html = rig._repr_html_()
    assert len(html) < 30_000
    assert not re.search(r"https?:|<script|src=", html)
    assert f"Rig of {len(rig)} camera" in html


def test_names_are_escaped():
    html = Rig((RIG["cam00"].renamed("<img src=x>"),), world_frame="<b>up</b>")._repr_html_()
    assert "<img" not in html
    assert "<b>" not in html
    assert "&lt;img src=x&gt;" in html
    assert "<i>" not in framed("<i>", facts([("<i>", "<i>")]))
