import io
import json

import numpy as np
import pytest
from PIL import Image
from tomo.draw.film.panels import LARGEST, palette, panels, png_of, shrunk

from tomo.draw.film.chart import BINS, HIGH, WIDE, chart, polylines
from tomo.draw.film.player import MOST_FRAMES, film_of, write_film_page
from tomo.grid import VoxelGrid

GRID = VoxelGrid((6, 9, 4), (1.0, 0.5, 2.0), (0.0, 3.0, 0.0))
HOSTILE = "</script><b>x & 'y'"


def volume_of(time):
    volume = np.zeros(GRID.shape, np.float32)
    volume[time % 6, 7, 1] = 2.0
    return volume


@pytest.fixture(scope="module")
def film():
    moments = [(f"{HOSTILE} {time}", time / 5, volume_of(time)) for time in range(6)]
    return film_of(moments, GRID, "mm", HOSTILE)


def test_panels_show_x_to_the_right_and_y_upward():
    found = {one.name: one for one in panels(volume_of(4), GRID)}
    front = found["maximum along z"]
    assert front.values.shape == (9, 6)
    assert np.argwhere(front.values).tolist() == [[1, 4]]  # y = 7 of 9 from below
    assert front.size == (6.0, 4.5)
    assert len(found) == 6


def test_voxels_that_nobody_sees_are_dark():
    volume = np.full(GRID.shape, np.nan, np.float32)
    assert all((one.values == 0).all() for one in panels(volume, GRID))


def test_pngs_have_the_colours_of_the_scale():
    steps = np.arange(256, dtype=np.uint8).reshape(16, 16)
    image = np.asarray(Image.open(io.BytesIO(png_of(steps))).convert("RGB"))
    assert np.array_equal(image.reshape(256, 3), palette())


def test_a_film_of_the_worst_pictures_stays_small():
    noise = np.random.default_rng(0).integers(0, 256, (LARGEST, LARGEST), np.uint8)
    assert shrunk(np.ones((900, 300))).shape == (LARGEST, round(LARGEST / 3))
    assert 6 * MOST_FRAMES * len(png_of(noise)) * 4 / 3 < 15e6


def test_curves_have_few_points_and_lose_no_extreme():
    heights = np.full(100_000, 0.5)
    heights[77_777] = 1.0
    (line,) = polylines(heights)
    points = np.array([one.split(",") for one in line.split()], float)
    assert len(points) <= 2 * BINS
    assert points[:, 1].min() == 0
    assert points[points[:, 1].argmin(), 0] == pytest.approx(0.77777 * WIDE, abs=0.1)
    assert points[:, 1].max() == HIGH / 2


def test_gaps_part_curves():
    lines = polylines(np.array([0.0, 1.0, np.nan, 0.5, np.nan]))
    assert len(lines) == 2
    assert len(lines[1].split()) == 2  # one point, twice


def test_charts_say_their_ends_and_the_figures_of_shown_frames():
    made = chart(
        "a", {"one": np.array([1.0, 2.0, np.nan]), "none": np.full(3, np.nan)}, shown=(1, 2)
    )
    assert (made.low, made.high) == ("1", "2")
    assert [one.name for one in made.curves] == ["one"]
    assert made.curves[0].values == ("2", "none")
    assert chart("a", {"none": np.full(3, np.nan)}) is None


@pytest.mark.parametrize("width", [1280, 400])
def test_the_film_plays_and_pauses_and_follows_the_slider(film, open_page, tmp_path, width):
    write_film_page(tmp_path / "film.html", film, title=HOSTILE, words="All frames.")
    page = open_page(tmp_path / "film.html", (width, 800))
    assert page.evaluate("return document.querySelector('h1').textContent;") == HOSTILE
    state = """
        const image = document.querySelector("img[data-panel='0']");
        return [document.getElementById("label").textContent, image.src.length,
                image.naturalWidth, document.documentElement.scrollWidth];
    """
    label, _, across, scroll = page.evaluate(state)
    assert label == f"{HOSTILE} 0"
    assert across == GRID.shape[0]
    assert scroll <= width
    page.evaluate(
        "const s = document.getElementById('moment'); s.value = 4;"
        "s.dispatchEvent(new Event('input'));"
    )
    assert page.evaluate(state)[0] == f"{HOSTILE} 4"
    page.evaluate("document.getElementById('play').click(); await pause(500);")
    assert page.evaluate("return document.getElementById('play').textContent;") == "Pause"
    played = page.evaluate(state)[0]
    assert played != f"{HOSTILE} 4"
    page.evaluate("document.getElementById('play').click();")
    stopped = page.evaluate(state)[0]
    page.evaluate("await pause(300);")
    assert page.evaluate(state)[0] == stopped


def test_every_frame_has_its_own_pictures(film):
    frames = json.loads(film["data"])
    assert len({one["images"][0] for one in frames}) == 6
    assert [one["at"] for one in frames] == [0, 0.2, 0.4, 0.6, 0.8, 1]
