"""docs/reference/films.md against the table of formats and the films of the tests."""

import re
import sys
from pathlib import Path

import pytest
from film_files import FILMS, LAYOUT

from rigs.recordings import FILM_FORMATS, open_recording, split_member
from rigs.recordings.film_formats.raw_film import PIXEL_TYPES

PAGE = Path(__file__).parents[3] / "docs" / "reference" / "films.md"


def rows(head):
    """Return the rows of the table whose head begins so, by their first cell."""
    lines = PAGE.read_text("utf-8").splitlines()
    start = next(number for number, line in enumerate(lines) if line.startswith(f"| {head} |"))
    found = {}
    for line in lines[start + 2 :]:
        if not line.startswith("|"):
            return found
        first, *others = (cell.strip() for cell in line.strip("|").split("|"))
        found[first.strip("`")] = others
    return found


def test_the_page_has_the_formats_of_the_table_in_their_order():
    page = rows("module")
    assert list(page) == [one.module for one in FILM_FORMATS]
    for one in FILM_FORMATS:
        named = re.findall(r"\.[a-z0-9]+\b", re.sub(r"\(.*?\)", "", page[one.module][0]))
        assert tuple(named) == one.suffixes


def test_packages_are_needed_as_the_page_says(tmp_path, monkeypatch):
    page, made = rows("module"), []
    for number, film in enumerate(FILMS.values()):
        (tmp_path / str(number)).mkdir()
        made.append(film.make(tmp_path / str(number))[0])
    needs = {name: row[1] for name, row in page.items()}
    for package in filter(None, needs.values()):
        monkeypatch.setitem(sys.modules, package, None)
    for path in made:
        suffix = split_member(path)[0].suffix
        name = next((one.module for one in FILM_FORMATS if suffix in one.suffixes), None)
        if name is not None and needs[name]:
            with pytest.raises(ValueError, match=rf"package {needs[name]}, which"):
                open_recording(path)
        else:
            open_recording(path)


def test_writers_of_the_tests_films_are_those_of_the_page(tmp_path):
    page = rows("module")
    writers = {name: set() for name in page}
    for number, film in enumerate(FILMS.values()):
        (tmp_path / str(number)).mkdir()
        reader = type(open_recording(film.make(tmp_path / str(number))[0]))
        writers[reader.__module__.rpartition(".")[2]].add(film.writer)
    writers["raw_film"] = {LAYOUT}
    assert {name: set(row[4].split(", ")) for name, row in page.items()} == writers


def test_pixels_of_raw_films_are_those_of_the_page():
    assert tuple(re.findall(r"`(\w+)`", rows("field")["dtype"][1])) == PIXEL_TYPES
