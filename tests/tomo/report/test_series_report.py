import re

import numpy as np
import pytest

from tomo.draw.film import MOST_FRAMES
from tomo.report.series import shown_places, write_series_report
from tomo.series.verdict import SeriesTable

HOSTILE = "<script>alert(1)</script>"


@pytest.fixture(scope="module")
def page(film_store, tmp_path_factory):
    path = tmp_path_factory.mktemp("page") / "report.html"
    write_series_report(path, SeriesTable.of(film_store), [f"gain drifts +4.0% {HOSTILE}"])
    return path


def test_the_page_loads_nothing_and_escapes_what_it_shows(page):
    text = page.read_text("utf-8")
    assert not re.findall(r"(?:src|href)=[\"'](?!data:)", text)
    assert "default-src 'none'" in text
    assert HOSTILE not in text
    assert "Gain drifts +4.0% &lt;script&gt;" in text


def test_the_film_comes_first_then_verdict_warnings_and_figures(page):
    text = page.read_text("utf-8")
    parts = (
        'class="stage"',
        'class="verdict',
        "What to do next",
        "Gain drifts",
        "31 dB",
        "<table",
    )
    order = [text.index(one) for one in parts]
    assert order == sorted(order)
    for title in ("PSNR", "Relative residual", "Light of each camera", "Total emission"):
        assert f"<b>{title}" in text


@pytest.mark.parametrize("width", [1280, 400])
def test_the_page_works_and_nothing_sticks_out(page, open_page, width):
    browser = open_page(page, (width, 800))
    assert browser.evaluate("return document.documentElement.scrollWidth;") <= width
    shown = """
        document.querySelector(".stage .play").click();  // a click on a curve ends it
        document.querySelector(".plot .area").dispatchEvent(new MouseEvent("click", {
          clientX: document.querySelector(".plot .area").getBoundingClientRect().right - 1}));
        return [document.querySelector(".stage output.moment").textContent,
                document.querySelector(".stage .film input").value,
                document.querySelector(".stage .play").textContent,
                document.querySelector(".cursor").style.left,
                document.querySelector("output[data-values]").textContent];
    """
    label, place, play, left, value = browser.evaluate(shown)
    assert label == "frame 69, 0.19 s"
    assert int(place) == browser.evaluate("return stages[0].data.volume.frames.length;") - 1
    assert play == "Play"
    assert left == "97.5%"
    assert value == "31"


def test_without_a_film_there_is_no_script(film_store, tmp_path):
    write_series_report(tmp_path / "report.html", SeriesTable.of(film_store), with_film=False)
    text = (tmp_path / "report.html").read_text("utf-8")
    assert "<script" not in text
    assert text.index('class="verdict') < text.index("<table")
    assert "data:image" not in text


def test_a_bounded_number_of_frames_is_shown_first_and_last_among_them():
    complete = np.ones(10_000, bool)
    complete[[0, 5]] = False
    shown = shown_places(complete)
    assert len(shown) == MOST_FRAMES
    assert (shown[0], shown[-1]) == (1, 9999)
    assert shown_places(complete[:9]) == [1, 2, 3, 4, 6, 7, 8]


def test_a_store_of_dark_frames_has_a_page(filled, tmp_path):
    dark = filled(
        tmp_path / "dark.zarr",
        [np.zeros((3, 4, 5), np.float32)] * 2,
        view_beyond_noise=[{}, {}],
        view_gain=[{}, {}],
        view_light=[{}, {}],
        psnr=[{}, {}],
        relative_residual=[np.nan, np.nan],
    )
    write_series_report(tmp_path / "report.html", SeriesTable.of(dark))
    assert "Not known" in (tmp_path / "report.html").read_text("utf-8")
