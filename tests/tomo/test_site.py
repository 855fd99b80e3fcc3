"""The site that tools/docs.sh built, named by TOMO_SITE: links, and pages in a browser."""

import os
import re
from functools import cache
from html.parser import HTMLParser
from pathlib import Path
from urllib.parse import unquote, urlsplit

import pytest

import phantoms
import rigs
import tomo

SITE = Path(os.environ.get("TOMO_SITE", "no site"))
pytestmark = pytest.mark.skipif(not SITE.is_dir(), reason="sh tools/docs.sh runs these")

MAIN = (
    "index.html",
    "guide/first_volume.html",
    "guide/your_cameras.html",
    "theory/calibration.html",
    "gallery/index.html",
    "gallery/first_volume.html",
    "api/tomo.html",
    "api/tomo.solvers.html",
    "results/benchmark.html",
    "reference/glossary.html",
    "CHANGELOG.html",
)
REQUESTS = ("Network.requestWillBeSent", "Network.loadingFailed")
WIDTHS = (1200, 400)  # pixels: a laptop's window and a phone
FETCHED = {("img", "src"), ("script", "src"), ("link", "href"), ("iframe", "src")}


class Page(HTMLParser):
    """What a page refers to, and what can be referred to in it."""

    def __init__(self, text):
        super().__init__()
        self.links, self.anchors, self.fetched, self.unnamed_images = [], set(), [], []
        self.feed(text)

    def handle_starttag(self, tag, attributes):
        found = dict(attributes)
        self.anchors.update(filter(None, (found.get("id"), found.get("name"))))
        if tag == "a" and found.get("href"):
            self.links.append(found["href"])
        self.fetched += [value for name, value in attributes if (tag, name) in FETCHED and value]
        beside_its_title = "sphx_glr" in found.get("src", "") and "_thumb" in found["src"]
        if tag == "img" and not found.get("alt") and not beside_its_title:
            self.unnamed_images.append(found.get("src"))


@cache
def page(path):
    return Page(path.read_text("utf-8"))


def pages():
    return sorted(path for path in SITE.rglob("*.html") if "_static" not in path.parts)


def leads_somewhere(path, link):
    parts = urlsplit(link)
    if parts.scheme or parts.netloc or link in ("#", "#top"):
        return True
    other = (path.parent / unquote(parts.path)).resolve() if parts.path else path
    if not other.is_file():
        return False
    anchor = unquote(parts.fragment)
    return not anchor or other.suffix != ".html" or anchor in page(other).anchors


def test_links_lead_to_files_and_anchors():
    assert not {
        f"{path.relative_to(SITE)}: {link}"
        for path in pages()
        for link in [*page(path).links, *page(path).fetched]
        if not leads_somewhere(path, link)
    }


def test_nothing_is_fetched_from_elsewhere():
    outside = {
        f"{path.relative_to(SITE)}: {link}"
        for path in pages()
        for link in page(path).fetched
        if urlsplit(link).scheme or urlsplit(link).netloc
    }
    assert not outside


def test_pictures_are_described():
    assert not {path.name: page(path).unnamed_images for path in pages()
                if page(path).unnamed_images}  # fmt: skip


@pytest.mark.parametrize("package", [tomo, rigs, phantoms], ids=lambda package: package.__name__)
def test_every_public_name_is_described(package):
    described = set().union(*(page(path).anchors for path in (SITE / "api").glob("*.html")))
    for name in package.__all__:
        full = f"{package.__name__}.{name}"
        assert {full, f"module-{full}"} & described, full


def test_formulas_and_terms_are_more_than_text():
    text = (SITE / "theory/calibration.html").read_text("utf-8")
    assert text.count("<math") > 20
    assert "$" not in re.sub(r"<script.*?</script>", "", text, flags=re.DOTALL)
    terms = re.findall(r'<a class="term[^>]*href="([^"]*)" title="', text)
    assert len(terms) > 5
    assert len(terms) == len(set(terms))  # the first use alone


def test_examples_show_the_picture_before_the_code():
    examples = sorted((SITE.parent / "docs/examples").glob("*.py"))
    assert examples
    for example in examples:
        text = (SITE / "gallery" / f"{example.stem}.html").read_text("utf-8")
        picture, code = text.find("sphx_glr_"), text.find('<div class="highlight-Python')
        assert 0 < picture < code, example.name


@pytest.mark.parametrize("width", WIDTHS)
@pytest.mark.parametrize("name", MAIN)
def test_main_pages_in_a_browser(browser, name, width):
    shown = open_at(browser, SITE / name, width)
    assert shown["lang"] == "en"
    assert shown["title"]
    assert shown["headings"] == 1
    assert shown["wide"] <= width, shown["wider"]
    assert shown["broken"] == []


def open_at(browser, path, width, query=""):
    """Open a page at a width, fail on what its console or network says, return what it shows."""
    browser.command("Network.enable")
    browser.problems()  # of the page before
    browser.command(
        "Emulation.setDeviceMetricsOverride",
        width=width, height=900, deviceScaleFactor=1, mobile=False,
    )  # fmt: skip
    browser.command("Page.navigate", url=path.as_uri() + query)
    shown = browser.evaluate("""
        while (document.readyState !== "complete") await new Promise((go) => setTimeout(go, 50));
        await new Promise((go) => setTimeout(go, 200));
        const all = [...document.querySelectorAll("main *")];
        return {
          lang: document.documentElement.lang, title: document.title,
          headings: document.querySelectorAll("h1").length,
          wide: document.documentElement.scrollWidth,
          wider: all.filter((e) => e.getBoundingClientRect().right > innerWidth)
                    .slice(0, 5).map((e) => e.outerHTML.slice(0, 150)),
          broken: [...document.images].filter((i) => i.complete && !i.naturalWidth && i.src)
                                      .map((i) => i.src),
        };
    """)
    told = [event for event in browser.events if event.get("method") in REQUESTS]
    urls = [event["params"].get("request", {}).get("url", "failed") for event in told]
    wrong = [url for url in urls if not url.startswith(("file:", "data:"))]
    assert not wrong
    assert browser.problems() == []
    return shown


def test_the_search_finds_a_page_without_a_server(browser):
    open_at(browser, SITE / "search.html", 1200, "?q=semi-convergence")
    found = browser.evaluate("""
        for (let k = 0; k < 200; k++) {
          const links = [...document.querySelectorAll("#search-results li a")];
          if (links.length) return links.map((a) => a.href);
          await new Promise((go) => setTimeout(go, 50));
        }
        return [];
    """)
    assert any("reference/glossary.html" in link for link in found)
