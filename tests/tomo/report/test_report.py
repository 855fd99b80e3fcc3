import base64
import itertools
import json
import re
from html.parser import HTMLParser

import cv2
import numpy as np
import pytest

from rigs import Camera, Rig, look_at
from tomo.draw import Scene
from tomo.draw.stage import Shown, stage
from tomo.grid import VoxelGrid
from tomo.pipeline import Reconstruction
from tomo.pipeline.view import Peak, View
from tomo.report import draw, write_pictures, write_report
from tomo.report.facts import PLACE, in_words, with_glossary
from tomo.report.pictures import view_pictures, views_to_show
from tomo.report.result_figures import draw_convergence, draw_difference
from tomo.solvers import Iteration, Solution

NO_RIG = Rig(())
GRID = VoxelGrid((6, 14, 8), (0.5, 1.0, 0.75))
HOSTILE = "<script>alert(1)<"


@pytest.fixture(scope="module")
def results():
    rng = np.random.default_rng(0)
    cameras = []
    for name, angle in (("cam00", 0.0), (HOSTILE, 1.0)):
        R, t = look_at([100 * np.sin(angle), 0, 100 * np.cos(angle)], [0, 0, 0])
        cameras.append(Camera(name, (9, 16), [[80, 0, 4], [0, 80, 8], [0, 0, 1]], R=R, t=t))
    truth = np.exp(-(GRID.centers() ** 2).sum(axis=-1) / 4).astype(np.float32)
    image = rng.random((16, 9)).astype(np.float32)
    history = (Iteration(1, 0.5, 0.1, 0.3), Iteration(2, 0.1, 0.2, 0.2))
    views = (View("cam00", image, image * 0.9), View(HOSTILE, image, image, held_out=True))
    other = solution(truth * 0, HOSTILE, history)
    return outcome_of(truth * 1.1, Rig(tuple(cameras)), views, truth=truth, comparisons=(other,))


def solution(volume, method="cgls", history=(), grid=GRID):
    return Solution(volume, grid, tuple(history), {"method": method})


def outcome_of(volume, rig=NO_RIG, views=(), grid=GRID, **more):
    return Reconstruction(solution(volume, grid=grid), rig, views, Peak(1.0, ""), **more)


@pytest.fixture(scope="module")
def pictures(results):
    return draw(results)


REPORT = {
    "method": "cgls",
    "relative_residual": 0.1234,
    "seconds": {"solve": 1.25, "total": 2.5},
    "quality": {"cosine_distance": 0.00123, "nrmse": 0.05},
    "held_out": {HOSTILE: {"psnr": 31.25, "ssim": 0.91, "cosine": 0.99}},
    "views": {"cam00": {"relative_residual": 0.1, "gain": 1.02}},
    "voxels": 126000,
    "seed": 7,
    "versions": {"numpy": "2.0"},
    "warnings": [f"camera {HOSTILE} looks beside"],
    "verdict": {
        "level": "amber",
        "sentence": "",
        "reasons": [f"camera {HOSTILE} is off", "few directions"],
        "next": ["run with --refine-cameras all"],
    },
    "answer": {"sentence": "Explained in part.", "verdict": "partly explained"},
    "carving": {"active_voxels": 31999, "noise": [{"read": 0.12345678}] * 2},
    "settings": {"note": "</script><script>alert(2)</script>", "hold_out": [HOSTILE]},
}


class Tags(HTMLParser):
    def __init__(self):
        super().__init__()
        self.found, self.text = [], []

    def handle_starttag(self, tag, attrs):
        self.found.append((tag, dict(attrs)))

    def handle_data(self, data):
        self.text.append(data)


@pytest.fixture(scope="module")
def written(tmp_path_factory, results, pictures):
    path = tmp_path_factory.mktemp("report") / "report.html"
    turned = stage(Scene(), shown=Shown((results.volume,)), turning=True)
    write_report(path, REPORT, results, pictures, stage=turned)
    return path


@pytest.fixture(scope="module")
def page(written):
    parser = Tags()
    parser.feed(written.read_text(encoding="utf-8"))
    return parser


def test_report_loads_nothing_and_runs_its_own_scripts_alone(page):
    assert not [tag for tag, _ in page.found if tag in ("link", "iframe", "object")]
    scripts = [attrs for tag, attrs in page.found if tag == "script"]
    data = {"type": "application/json"}
    assert scripts == [data, data, {}, {}]  # of the volume and the views; what shows them
    policy = [attrs["content"] for tag, attrs in page.found if "http-equiv" in attrs]
    assert policy[0].startswith("default-src 'none'; img-src data:;")
    sources = [attrs["src"] for tag, attrs in page.found if tag == "img"]
    assert len(sources) == 8  # the volume, three of one view, and the four pictures
    assert all(source.startswith("data:image/png;base64,") for source in sources)
    assert all(attrs.get("alt") for tag, attrs in page.found if tag == "img")


def test_hostile_names_are_shown_as_text(page):
    text = "".join(page.text)
    assert f"{HOSTILE} (held out)" in text
    data = [json.loads(one) for one in page.text if one.startswith('[{"words"')]
    assert [entry["words"].split(":")[0] for entry in data[0]] == [
        "cam00, explained least",
        f"{HOSTILE}, held out",
    ]
    assert "</script><script>alert(2)</script>" in text


def test_report_shows_its_figures(page):
    text = " ".join(page.text)
    for shown in ("0.00123", "12.34%", "31.2 dB", "0.91", "1.02", "2.5 s", "126,000", "Good: be"):
        assert shown in text
    assert re.search(r"seed\s+7", text)
    assert re.search(r"noise\s+read: 0\.1235; read: 0\.1235", text)
    assert re.search(r"active voxels\s+31,999", text)


@pytest.mark.parametrize(
    ("value", "words"),
    [
        ([], "none"),
        ({}, "none"),
        (True, "yes"),
        ([0.5, None], "0.5, not known"),
        ({f"cam{n}": [0.0, 0.0] for n in range(33)}, "0, 0 (all 33)"),
        ({"a": [0.5, 0.25], "b": [1.0, 2.0], "c": [1.0, 2.0]}, "a: 0.5, 0.25; b: 1, 2; c: 1, 2"),
        ([["nnls", 0.5, 1700], ["mlem", 0.0, 20]], "nnls, 0.5, 1,700; mlem, 0, 20"),
    ],
)
def test_settings_are_shown_in_words(value, words):
    assert in_words(value) == words


def test_the_volume_and_the_verdict_come_first_then_steps_findings_and_tables(page):
    tags = [tag for tag, _ in page.found]
    assert tags.index("img") < tags.index("section") < tags.index("table")
    text = " ".join(page.text)
    order = ("Amber", "Use with care", "is off.", "Few directions.", "What to do next",
             "looks beside", "Does it explain its images?", "Settings and versions",
             "Words of this page")  # fmt: skip
    places = [text.index(one) for one in order]
    assert places == sorted(places)


def test_a_glossary_explains_the_terms_that_a_page_uses():
    page = with_glossary(f"<style>PSNR</style><p>NRMSE 0.1</p>{PLACE}")
    assert "<dt>NRMSE</dt>" in page
    assert "PSNR</dt>" not in page
    assert with_glossary(f"<p>x</p>{PLACE}") == "<p>x</p>"


@pytest.mark.parametrize("width", [1200, 400])
def test_the_page_is_readable_without_network_mouse_or_colours_and_steps_through_the_views(
    written, results, open_page, width
):
    browser = open_page(written, (width, 800))
    assert browser.evaluate("return document.documentElement.scrollWidth;") <= width
    unlabelled = """
        const scrolls = [...document.querySelectorAll(".scroll, .wide")];
        return scrolls.filter((one) => one.tabIndex || !one.getAttribute("aria-label")).length;
    """
    assert browser.evaluate(unlabelled) == 0
    assert browser.evaluate(CONTRAST) >= 4.5
    assert browser.evaluate("return performance.getEntriesByType('resource').length;") == 0
    entries = json.loads(view_pictures(results.views)["data"])
    assert browser.evaluate("return stages[0].root.classList.contains('alive');")
    seen = """
        const images = [...compared.querySelectorAll("img")];
        return [compared.querySelector("output").textContent, images.map((one) => one.src)];
    """
    steps = ("", *(f"compared.querySelectorAll('button')[{side}].click();" for side in (1, 1, 0)))
    for step, place in zip(steps, (0, 1, 0, 1), strict=True):
        expected = entries[place]
        assert browser.evaluate(step + seen) == [expected["words"], expected["images"]]


CONTRAST = """
    function light(text) {
      const part = text.match(/[0-9.]+/g).slice(0, 3).map((one) => {
        const c = one / 255;
        return c <= 0.03928 ? c / 12.92 : ((c + 0.055) / 1.055) ** 2.4;
      });
      return 0.2126 * part[0] + 0.7152 * part[1] + 0.0722 * part[2];
    }
    function behind(one) {
      for (; one; one = one.parentElement) {
        const colour = getComputedStyle(one).backgroundColor;
        if (colour !== "rgba(0, 0, 0, 0)") return colour;
      }
      return "rgb(255, 255, 255)";
    }
    let least = 21;
    for (const one of document.querySelectorAll("h1, h2, .badge, p, li, dt, dd, th, td")) {
      const [a, b] = [light(getComputedStyle(one).color), light(behind(one))];
      least = Math.min(least, (Math.max(a, b) + 0.05) / (Math.min(a, b) + 0.05));
    }
    return least;
"""
"""The least contrast of a text with what is behind it, by WCAG; 4.5 is asked for."""


def test_report_does_with_little(tmp_path):
    outcome = outcome_of(np.zeros(GRID.shape, np.float32))
    pictures = draw(outcome)
    unknown = {"relative_residual": None, "seed": None, "held_out": {"a": {"psnr": None}}}
    for report in ({}, unknown):
        write_report(tmp_path / "report.html", report, outcome, pictures)
    assert "The reconstructed emission" in (tmp_path / "report.html").read_text(encoding="utf-8")


def test_pictures_are_written_as_they_are_shown(tmp_path, pictures):
    paths = write_pictures(tmp_path / "new", pictures)
    assert {p.stem for p in paths} == {"rig", "flame", "convergence", "difference"}
    for path, picture in zip(paths, pictures, strict=True):
        assert path.read_bytes() == picture.png
        assert picture.png.startswith(b"\x89PNG")


def test_held_out_views_are_shown_first_and_the_others_spread():
    image = np.ones((2, 2))
    views = [View(f"{i}", image, image, held_out=i == 20) for i in range(33)]
    names = [int(v.name) for v in views_to_show(views, 5)]
    assert names[:2] == [20, 0]
    assert names[2:] == [1, 11, 23]


@pytest.mark.parametrize("most", [2, 6])
def test_the_least_explained_view_is_always_shown(most):
    image = np.ones((2, 2))
    views = [View(f"{i}", image, image * (0.4 if i == 17 else 1.0)) for i in range(33)]
    views += [View(f"held out {i}", image, image, held_out=True) for i in range(8)]
    shown = [view.name for view in views_to_show(views, most)]
    assert "17" in shown
    assert len(shown) == len(set(shown)) == most


def pixels(embedded):
    """Return the red, green and blue of a picture that a page carries."""
    encoded = np.frombuffer(base64.b64decode(embedded.split(",")[1]), np.uint8)
    return cv2.imdecode(encoded, cv2.IMREAD_COLOR)[..., ::-1].astype(int)


def test_a_difference_is_red_where_the_volume_is_too_bright_and_blue_where_too_dark():
    measured = np.full((8, 12), 2.0)
    reprojected = measured + np.repeat([0.5, -0.5, 0.0], 4)
    mask = np.ones(measured.shape, bool)
    mask[:2] = False
    entries = json.loads(view_pictures([View("a", measured, reprojected, mask)])["data"])
    red, _, blue = np.moveaxis(pixels(entries[0]["images"][2])[2:], -1, 0)
    assert (red > blue + 50)[:, :4].all()
    assert (blue > red + 50)[:, 4:8].all()
    assert (np.minimum(red, blue) > 230)[:, 8:].all()
    for picture in map(pixels, entries[0]["images"]):
        assert (picture[:2] == (0xB9, 0xC0, 0xC7)).all()  # grey: not used


def test_the_convergence_of_dark_images_is_drawn():
    """One method ends at once, another goes on for long, and no residual is above zero."""
    figure = draw_convergence(
        [
            solution(np.zeros(GRID.shape), "nnls", [Iteration(0, 0.0, 1e-4)]),
            solution(np.zeros(GRID.shape), "tv", [Iteration(0, 0.0, 0.0), Iteration(1, 0.0, 1.0)]),
        ]
    )
    assert len(figure.axes) == 2


@pytest.mark.parametrize(("center", "with_truth"), [(0.0, False), (1e5, True)])
def test_numbers_below_neighbouring_planes_lie_apart(center, with_truth):
    grid = VoxelGrid((20, 50, 20), 1.0, (center, 0.0, center))
    volume = np.ones(grid.shape, np.float32)
    truth = volume if with_truth else None
    other = solution(volume, "other", grid=grid)
    figure = draw_difference(outcome_of(volume, grid=grid, truth=truth, comparisons=(other,)))
    figure.canvas.draw()
    rows = {}
    for axes in figure.axes:
        low, high = sorted(axes.get_xlim())
        for tick in axes.xaxis.get_major_ticks():
            if low <= tick.get_loc() <= high and tick.label1.get_visible() and axes.get_xlabel():
                box = tick.label1.get_window_extent()
                rows.setdefault(round(box.y0), []).append((box.x0, box.x1))
    assert rows
    for spans in rows.values():
        assert len(spans) >= 3
        assert all(a[1] < b[0] for a, b in itertools.pairwise(sorted(spans)))
