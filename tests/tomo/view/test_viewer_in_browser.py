"""The viewer's page: what it shows of films, rigs and odd volumes, and whom it asks."""

import json
from dataclasses import replace

import numpy as np
import pytest

from tomo.grid import VoxelGrid
from tomo.view import Content, Viewer, content_of_rig
from tomo.view.content import Frames
from tomo.view.page import Page

HOSTILE = "</script><img src=x onerror=alert(1)> & 'y'"
BRIGHTEST = """
const brightest = () => {
  const { light, canvas } = stages[0], view = stages[0].view(canvas.width, canvas.height);
  return light.integrals(view).reduce((a, b) => Math.max(a, b), 0);
};
"""
COMPARED = """
for (let k = 0; k < 400 && compared.getAttribute("aria-busy") !== "false"; k++) await pause(50);
"""


@pytest.fixture
def open_viewer(browser, open_page):
    """Return a function that opens the page of a content, and stops all at the end."""
    opened = []

    def opening(content, size=(1280, 800), camera=None):
        opened.append(Viewer(content, port=18080))
        browser.command("Network.enable")
        url = opened[-1].choose(camera) if camera else opened[-1].url
        return open_page(url, size)

    yield opening
    browser.command("Page.navigate", url="about:blank")
    browser.command("Network.disable")
    for viewer in opened:
        viewer.stop()


def moved(label, value):
    """Return a script that moves a slider or a list as a hand does."""
    return f"""
    const control = document.querySelector('[aria-label="{label}"]');
    control.value = {value!r};
    for (const kind of ["input", "change"]) control.dispatchEvent(new Event(kind));
    """


def shown_as(label):
    """Return a script that waits until a frame is shown."""
    return (
        "await until(() => document.querySelector('.moment').textContent ==="
        f" {json.dumps(label)}); await pause(100);"
    )


def test_it_opens_on_the_light_with_bar_axes_values_and_images(open_viewer, content):
    content = replace(content, value_unit="counts per mm")
    page = open_viewer(content)
    found = page.evaluate(
        COMPARED
        + """
        const stage = stages[0], { canvas } = stage, box = canvas.getBoundingClientRect();
        const at = { bubbles: true, clientX: box.left + box.width / 2,
          clientY: box.top + box.height / 2, pointerId: 1 };
        canvas.dispatchEvent(new PointerEvent("pointermove", at));
        await pause(300);
        return { layers: [...stage.visible()], bar: document.querySelector(".bars b").textContent,
          axes: [...document.querySelectorAll(".title")].map((one) => one.textContent),
          value: stage.readout.textContent, zoom: stage.data.zooms[stage.data.zoom].label,
          note: document.querySelector(".note").textContent };
        """
    )
    assert {"light", "cameras", "images", "box"} <= set(found["layers"])
    assert found["zoom"] == "Volume"
    assert found["bar"] == "light along the line of sight (counts)"
    assert sorted(found["axes"])[:3] == ["x (mm)", "y (mm)", "z (mm)"]
    assert found["value"].endswith(" counts")
    assert float(found["value"].split()[0]) > 1
    assert "12 x 16 x 10 voxels, 100 % is 0.9" in found["note"]


def test_a_camera_is_compared_beside_the_light_and_follows_the_frame(open_viewer, content):
    page = open_viewer(content, camera="cam01")
    looked = """
        const stage = stages[0], sight = document.querySelector(".sight").getBoundingClientRect();
        const panel = compared.getBoundingClientRect();
        return [compared.querySelector("output").textContent,
          [...compared.querySelectorAll("img")].map((one) => one.naturalHeight),
          panel.top >= sight.bottom, document.documentElement.scrollHeight];
    """
    words, heights, is_beside, height = page.evaluate(COMPARED + looked)
    assert words.startswith("cam01: residual 0.0%")
    assert "re-projected light: 1." in words
    assert min(heights) > 20
    assert is_beside
    assert height <= 800
    # a click on a camera's symbol chooses it
    page.evaluate(
        """
        const stage = stages[0];
        compared.removeAttribute("aria-busy");
        for (const heard of stage.listeners) heard({ name: "cam02" });
        """
    )
    assert page.evaluate(COMPARED + looked)[0].startswith("cam02: residual 0.0%")
    first = page.evaluate("return compared.querySelector('img').src;")
    page.evaluate("compared.removeAttribute('aria-busy');" + moved("Frame of the film", 2))
    page.evaluate(COMPARED)
    assert page.evaluate("return compared.querySelector('img').src;") != first


def test_a_film_plays_and_asks_no_other_host(browser, open_viewer, content, flames):
    frames = Frames(("start", "middle", HOSTILE), lambda place: flames[place] * (1 + place))
    page = open_viewer(replace(content, frames=frames, title=HOSTILE))
    state = f"{BRIGHTEST} return [document.querySelector('.moment').textContent, brightest()];"
    label, dim = page.evaluate(state)
    assert label == "start"
    page.evaluate(moved("Frame of the film", 2) + shown_as(HOSTILE))
    label, bright = page.evaluate(state)
    assert label == HOSTILE
    assert bright == pytest.approx(3 * dim, rel=0.1)
    assert page.evaluate("return document.querySelector('h1').textContent;") == HOSTILE
    press = "document.querySelector('.play').click();"
    page.evaluate(moved("Frames a second", "30") + press + "await pause(400);")
    assert page.evaluate("return document.querySelector('.play').textContent;") == "Pause"
    page.evaluate(press + "await pause(300);")
    stopped = page.evaluate(state)[0]
    page.evaluate("await pause(200);")
    assert page.evaluate(state)[0] == stopped
    asked = [
        event["params"]["request"]["url"]
        for event in browser.events
        if event.get("method") == "Network.requestWillBeSent"
    ]
    own = page.evaluate("return location.origin;")
    assert {f"{own}/", f"{own}/volume/2", f"{own}/images/2", f"{own}/volume/1"} <= set(asked)
    assert [url for url in asked if not url.startswith((own, "data:", "about:"))] == []


def test_pictures_in_the_symbols_follow_the_moment(content):
    page = Page(replace(content, frames=None))
    assert page.images(0).shape == page.images(2).shape
    assert (page.images(0) != page.images(2)).any()
    assert page.images(0).min() >= 1


def test_images_of_a_scan_are_stepped_through_without_a_volume(open_viewer, scan):
    page = open_viewer(content_of_rig("scan", scan.rig, None, scan))
    assert page.evaluate("return stages[0].data.volume;") is None
    before = "const images = [...compared.querySelectorAll('figure')].map((one) => one.hidden);"
    found = page.evaluate(
        COMPARED + before + "return [compared.querySelector('output').textContent, images];"
    )
    assert found == ["cam00", [False, True, True]]
    page.evaluate(moved("Frame of the film", 1) + shown_as("frame_001"))
    assert page.evaluate("return document.querySelector('.moment').textContent;") == "frame_001"


def test_maximum_colours_planes_and_surfaces_are_shown(open_viewer, content):
    page = open_viewer(content)
    peak = content.frames.volume(0).max()
    found = page.evaluate(
        BRIGHTEST
        + moved("what is shown along the line of sight", "maximum")
        + """
        const [bar, most] = [document.querySelector(".bars b").textContent, brightest()];
        const stage = stages[0], before = stage.data.volume.colours;
        """
        + moved("colours", "viridis")
        .replace("const control", "const other")
        .replace("control", "other")
        + """
        stage.choose("plane x", true);
        stage.choose("surfaces", true);
        return [bar, most, stage.data.volume.colours !== before, stage.light.planes.length,
          stage.light.levels.length];
        """
    )
    assert found[0] == "largest on the line of sight (emission)"
    assert found[1] == pytest.approx(peak, rel=0.03)
    assert found[2:] == [True, 1, 2]


@pytest.mark.parametrize(("shape", "value"), [((1, 1, 1), 2.0), ((5, 1, 40), np.nan)])
def test_dark_and_tiny_volumes_and_a_film_of_one_frame_are_shown(open_viewer, shape, value):
    frames = Frames((HOSTILE,), lambda _: np.full(shape, value))
    page = open_viewer(Content(HOSTILE, None, VoxelGrid(shape, 2.0), frames, value_unit=HOSTILE))
    found = page.evaluate(
        BRIGHTEST + "return [brightest(), document.getElementById('moment'),"
        "document.querySelector('.bars b').textContent,"
        " document.querySelector('.beside').innerText];"
    )
    assert (found[0] > 0) == (value == 2)
    assert found[1] is None
    assert HOSTILE in found[2]
    assert found[3] == ""


def test_a_large_volume_is_shown_coarser_and_the_page_says_so(monkeypatch):
    monkeypatch.setattr("tomo.draw.stage.MOST_VOXELS", 4000)
    grid = VoxelGrid((30, 30, 30), 0.1)
    frames = Frames(("large",), lambda _: np.ones(grid.shape))
    page = Page(Content("large", None, grid, frames))
    assert (
        "Shown on 15 x 15 x 15 voxels, means of blocks of the volume's 30 x 30 x 30" in page.html
    )
    assert page.volume(0).shape == (15, 15, 15)
    assert (page.volume(0) == 255).all()


def test_a_narrow_page_fits_and_errors_are_said(open_viewer, content, flames):
    def read(place):
        if place == 1:
            raise ValueError(f"frame 1: {HOSTILE}")
        return flames[place]

    frames = Frames(("a", "b", "c"), read)
    frames.__dict__["spread"] = lambda: [0]
    page = open_viewer(replace(content, frames=frames, scan=None, moments=()), (400, 800))
    assert page.evaluate("return document.documentElement.scrollWidth;") <= 400
    page.evaluate(moved("Frame of the film", 1) + "await until(() => told.textContent);")
    said = "return document.getElementById('told').textContent;"
    assert page.evaluate(said) == f"Not shown: frame 1: {HOSTILE}"
    page.evaluate(moved("Frame of the film", 2) + "await until(() => !told.textContent);")
    assert page.evaluate(said) == ""
    # the browser itself reports the failed answer
    assert all("500" in one for one in page.problems())


def test_without_webgl_a_picture_stands_in_and_cameras_are_compared(browser, open_viewer, content):
    with browser.without_webgl():
        found = open_viewer(content).evaluate(
            COMPARED + "const image = document.querySelector('.sight img');"
            "return [image.hidden, image.naturalWidth,"
            " getComputedStyle(stages[0].canvas).display,"
            " document.querySelector('.controls').textContent,"
            " compared.querySelector('output').textContent];"
        )
    assert found[0] is False
    assert found[1] > 200
    assert found[2] == "none"
    assert "offers no WebGL2" in found[3]
    assert found[4].startswith("cam00: residual")
