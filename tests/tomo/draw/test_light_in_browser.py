"""The pages' ray-marcher: its line integrals, what it shows of odd volumes, and without WebGL2."""

import base64
import json
import re

import numpy as np
import pytest

from tomo.draw import Scene, visualize_volume, write_html
from tomo.draw.emission import Looks, emission_image, eye_of
from tomo.draw.film import film_of
from tomo.draw.frame import Up
from tomo.draw.stage import Shown
from tomo.grid import Volume, VoxelGrid

GRID = VoxelGrid((14, 30, 18), (0.5, 0.4, 0.6), (3.0, -20.0, 8.0))
HOSTILE = "</script><b>x & 'y'"
SMALL = (500, 400)

BRIGHTEST = """
const brightest = () => {
  const { light, canvas } = stages[0], view = stages[0].view(canvas.width, canvas.height);
  return light.integrals(view).reduce((a, b) => Math.max(a, b), 0);
};
"""


def flame():
    x, y, z = np.moveaxis(GRID.centers() - GRID.center, -1, 0)
    rim = np.exp(-((np.hypot(x - 0.4 * np.sin(y), z) - 2.0) ** 2))
    return Volume((rim * np.exp(-((y + 1) ** 2) / 20)).astype(np.float32), GRID)


def drawn(page):
    """Return the page's data."""
    return json.loads(re.search(r'"application/json">(.*?)</script>', page, re.DOTALL)[1])


@pytest.mark.parametrize(("azimuth", "up"), [(28.0, Up()), (100.0, Up(2, -1)), (0.0, Up(1, -1))])
def test_line_integrals_are_the_operator_s_own(open_page, tmp_path, azimuth, up):
    """The mean difference for the same 8 bits and camera is at most 1 % of the brightest."""
    write_html(tmp_path / "a.html", Scene(), up=up, shown=Shown((flame(),)))
    volume = drawn((tmp_path / "a.html").read_text("utf-8"))["volume"]
    eight_bits = np.frombuffer(base64.b64decode(volume["frames"][0]), np.uint8)
    values = eight_bits.reshape(GRID.shape) * np.float32(volume["highest"] / 255)
    viewpoint = eye_of(GRID, (240, 320), azimuth, up)
    view = {
        "eye": (viewpoint.eye - GRID.center).tolist(),
        "axes": viewpoint.axes.tolist(),
        "focal": viewpoint.focal,
        "principal": viewpoint.principal.tolist(),
        "depths": [0.1, 1000.0],
        "lamp": [0, 0, 1],
    }
    found = open_page(tmp_path / "a.html", SMALL).evaluate(
        f"""
        const light = stages[0].light;
        Object.assign(light.canvas, {{ width: 240, height: 320 }});
        return [...light.integrals({json.dumps(view)})];
        """
    )
    expected = emission_image(Volume(values, GRID), viewpoint)
    difference = np.abs(np.reshape(found, (320, 240)) - expected)
    assert expected.max() > 1
    assert difference.mean() < 0.01 * expected.max()
    assert difference.max() < 0.03 * expected.max()


def test_what_turns_and_cuts_and_passes_a_threshold_is_what_the_numbers_say(open_page, tmp_path):
    write_html(tmp_path / "a.html", Scene(), shown=Shown((Volume(np.ones(GRID.shape), GRID),)))
    whole, half, dark, named = open_page(tmp_path / "a.html", SMALL).evaluate(
        """
        const stage = stages[0], { canvas } = stage, view = stage.view();
        Object.assign(canvas, { width: canvas.clientWidth, height: canvas.clientHeight });
        const total = () => stage.light.integrals(view).reduce((a, b) => a + b, 0);
        const out = [total()];
        stage.cutAxis.value = "y";
        stage.update();
        out.push(total());
        stage.cutAxis.value = "no cut";
        stage.threshold.value = 100;
        stage.light.threshold = 1.01;
        out.push(total());
        stage.update();
        return [...out, document.querySelector(".bars b").textContent];
        """
    )
    assert half == pytest.approx(whole / 2, rel=0.05)
    assert dark == 0
    assert named == "light along the line of sight (emission × mm)"


@pytest.mark.parametrize(
    ("shape", "value"), [((1, 1, 1), 0.0), ((6, 8, 7), 1e-30), ((1, 90, 2), 3.0)]
)
def test_dark_and_tiny_volumes_are_shown(open_page, tmp_path, shape, value):
    grid = VoxelGrid(shape, 2.0)
    volume = np.full(shape, value, np.float32)
    write_html(tmp_path / "a.html", Scene(), shown=Shown((Volume(volume, grid),)))
    most = open_page(tmp_path / "a.html", SMALL).evaluate(f"{BRIGHTEST} return brightest();")
    longest = float(np.linalg.norm(grid.extent)) * value
    assert most <= 1.01 * longest
    assert most >= 0.5 * value * min(grid.extent)


@pytest.mark.parametrize(("width", "levels"), [(1280, ()), (400, (0.2, 0.6))])
def test_a_page_opens_as_asked_and_fits(open_page, tmp_path, width, levels):
    looks = Looks(levels, "viridis")
    visualize_volume(tmp_path / "a.html", flame(), title=HOSTILE, looks=looks)
    opened = open_page(tmp_path / "a.html", (width, 800))
    found = opened.evaluate(
        "return [document.querySelector('h1').textContent, [...stages[0].visible()],"
        " stages[0].light.levels, document.documentElement.scrollWidth,"
        " document.querySelector('.sight img').hidden];"
    )
    assert found[:3] == [HOSTILE, ["surfaces" if levels else "light"], list(levels)]
    assert found[3] <= width
    assert found[4]


def test_a_film_plays_and_pauses_and_follows_the_slider(open_page, tmp_path):
    moments = [
        (f"{HOSTILE} {time}", time / 5, flame().like(flame() * (1 + time), HOSTILE))
        for time in range(6)
    ]
    write_html(tmp_path / "film.html", Scene(), title=HOSTILE, shown=film_of(moments, 6))
    page = open_page(tmp_path / "film.html", (400, 800))
    assert page.evaluate("return document.querySelector('h1').textContent;") == HOSTILE
    state = f"{BRIGHTEST} return [document.querySelector('.moment').textContent, brightest()];"
    label, dim = page.evaluate(state)
    assert label == f"{HOSTILE} 0"
    page.evaluate(
        "const s = document.getElementById('moment'); s.value = 4;"
        "s.dispatchEvent(new Event('input'));"
    )
    label, bright = page.evaluate(state)
    assert label == f"{HOSTILE} 4"
    assert bright == pytest.approx(5 * dim, rel=0.1)
    press = "document.querySelector('.play').click(); await pause(300);"
    page.evaluate(press)
    assert page.evaluate("return document.querySelector('.play').textContent;") == "Pause"
    assert page.evaluate(state)[0] != f"{HOSTILE} 4"
    page.evaluate(press)
    stopped = page.evaluate(state)[0]
    page.evaluate("await pause(300);")
    assert page.evaluate(state)[0] == stopped
