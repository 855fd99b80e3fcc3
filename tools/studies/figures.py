"""The tables of README and docs/results: ``python tools/studies/figures.py [RUN ...]``.

A ``RUN`` is the JSON that a study wrote, such as out/benchmark/benchmark.json. The tables of its
parts that pages show go into docs/results/figures.json, in place of those that were there; then
every table is written anew.

A page says where a table stands, which columns of which table it has, and which of its rows::

    <!-- figures: benchmark accuracy accuracy; flame, nrmse by noise; views=33,11 -->
    <!-- end of figures -->

A comma or a space stands between two columns. ``peak_bytes * 1e-6 = peak (MB)`` multiplies a
column and names it; ``nrmse by noise`` makes a column of each noise, for rows that are alike in
all columns before the first such.
"""

from __future__ import annotations

import json
import re
import sys
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[2]
if __name__ == "__main__":
    sys.path[:0] = [str(ROOT), str(ROOT / "tools")]

from rigs.files import atomic_path  # noqa: E402
from studies.common.fingerprint import hash_of  # noqa: E402
from studies.common.page import cell, markdown, significant  # noqa: E402

FIGURES = ROOT / "docs/results/figures.json"
PLACE = re.compile(r"(<!-- figures: ([^>]*?) -->\n).*?(<!-- end of figures -->)", re.DOTALL)
OF_A_RUN = ("commit", "machine", "size", "seed", "version")
DEFAULTS = "defaults"
"""Not a study: the modules of each default that a part was measured with, by their hash."""

Figures = Mapping[str, Mapping[str, Any]]


def pages(root: Path = ROOT) -> list[Path]:
    """Return the files that may have tables."""
    return [root / "README.md", *sorted((root / "docs/results").glob("*.md"))]


def with_run(figures: Figures, run: Mapping[str, Any]) -> dict[str, Any]:
    """Return the figures with the parts of a run in place of those that were there."""
    study, default = run["study"], run["default"]
    origin = {key: run[key] for key in OF_A_RUN} | {"default": default["hash"]}
    parts = {name: {**record, **origin} for name, record in run["parts"].items()}
    found = {**figures, study: {**figures.get(study, {}), **parts}}
    used = {
        record["default"] for name in found if name != DEFAULTS for record in found[name].values()
    }
    known = {**figures.get(DEFAULTS, {}), default["hash"]: default["modules"]}
    return found | {DEFAULTS: {key: known[key] for key in known if key in used}}


def with_tables(text: str, figures: Figures, where: str) -> str:
    """Return a page with its tables as the figures have them; all that it names must be there."""

    def filled(place: re.Match) -> str:
        address, columns, *chosen = (part.strip() for part in place[2].split(";"))
        study, part, table = address.split()
        record = figures.get(study, {}).get(part)
        if record is None:
            return f"{place[1]}Not measured yet: {_command(study, part)}\n{place[3]}"
        conditions = _conditions("".join(chosen))
        rows = [row for row in record["tables"].get(table, ()) if _is_chosen(row, conditions)]
        if not rows:
            raise ValueError(f"{where}: no rows of {place[2]!r} in {FIGURES.name}")
        known = {key for row in rows for key in row}
        wanted = [_Column.parsed(words) for words in _split(columns)]
        for key in (key for one in wanted for key in (one.key, *one.by) if key not in known):
            raise ValueError(f"{where}: {address}: found no column {key}")
        return f"{place[1]}{markdown(_arranged(rows, wanted))}\n\n{_made(record)}\n{place[3]}"

    return PLACE.sub(filled, text)


@dataclass(frozen=True)
class _Column:
    """A column of a page: a key of the rows, by which others, times what, under which heading."""

    key: str
    by: tuple[str, ...]
    factor: float
    heading: str

    @classmethod
    def parsed(cls, words: str) -> _Column:
        what, _, heading = (part.strip() for part in words.partition("="))
        what, _, factor = (part.strip() for part in what.partition("*"))
        key, *by = what.replace(" by ", " ").split()
        return cls(key, tuple(by), float(factor or 1), heading)

    def name(self, row: Mapping[str, Any]) -> str:
        """Return the heading above a row's value."""
        values = ", ".join(cell(row[key]) for key in self.by)
        return ", ".join(filter(None, (values, self.heading))) or self.key.replace("_", " ")

    def value(self, row: Mapping[str, Any]) -> Any:
        """Return a row's value."""
        found = row.get(self.key)
        return found * self.factor if self.factor != 1 and found is not None else found


def _split(columns: str) -> list[str]:
    return columns.split(",") if re.search("[,=*]", columns) else columns.split()


def _arranged(rows: Sequence[Mapping[str, Any]], columns: Sequence[_Column]) -> list[dict]:
    """Return rows by heading; rows that are alike but for what columns are ``by`` become one."""
    first = next((n for n, one in enumerate(columns) if one.by), None)
    names = dict.fromkeys(one.name(row) for row in rows for one in columns)
    found: dict[Any, dict] = {}
    for number, row in enumerate(rows):
        same = number if first is None else tuple(one.value(row) for one in columns[:first])
        line = found.setdefault(same, dict.fromkeys(names))
        line.update({one.name(row): one.value(row) for one in columns})
    return list(found.values())


def _made(record: Mapping[str, Any]) -> str:
    """Return where and at what cost a part was measured."""
    cpu, cores = (record["machine"][key] for key in ("cpu", "cores"))
    size = "" if record["size"] == "full" else f", size {record['size']}"
    seconds = record.get("cpu_seconds")
    cost = f"; the part took {significant(seconds / 60, 2)} minutes of a core" if seconds else ""
    return f"Commit {record['commit']}{size}; {cpu}, {cores} cores{cost}."


def stale(figures: Figures) -> list[str]:
    """Return a line for each part that was measured with another default than the tree's."""
    lines = []
    current = {of_run: hash_of(modules) for of_run, modules in figures[DEFAULTS].items()}
    for study in figures.keys() - {DEFAULTS}:
        for part, record in figures[study].items():
            if current[record["default"]] != record["default"]:
                again = _command(study, part, record.get("command"))
                lines.append(
                    f"{FIGURES.name}: {study} {part}: measured at {record['commit']}, the default "
                    f"has changed since; repeat: {again}"
                )
    return lines


def _command(study: str, part: str, command: str | None = None) -> str:
    """Return what measures a part and takes it into the figures."""
    again = command or f"python tools/{study}.py --part {part}"
    return f"{again} -o out/{study} && python tools/studies/figures.py out/{study}/{study}.json"


def main(runs: Iterable[str]) -> None:
    """Take what pages show of runs into the figures, and write the tables of pages."""
    figures = json.loads(FIGURES.read_text("utf-8")) if FIGURES.is_file() else {}
    texts = {page: page.read_text("utf-8") for page in pages()}
    shown = _shown(texts.values())
    for path in runs:
        run = json.loads(Path(path).read_text("utf-8"))
        for part, record in run["parts"].items():
            record["tables"] = {
                table: [{key: row[key] for key in row if key in keys} for row in rows]
                for table, rows in record["tables"].items()
                if (keys := shown.get((run["study"], part, table)))
            }
        figures = with_run(figures, run)
    written = {page: with_tables(text, figures, page.name) for page, text in texts.items()}
    for page, text in ({FIGURES: _a_line_a_row(figures)} | written).items():
        with atomic_path(page) as temporary:
            temporary.write_text(text, "utf-8")


def _shown(texts: Iterable[str]) -> dict[tuple[str, ...], set[str]]:
    """Return the keys that pages show or choose rows by, of each study, part and table."""
    found: dict[tuple[str, ...], set[str]] = {}
    for place in PLACE.finditer("\n".join(texts)):
        address, columns, *chosen = place[2].split(";")
        keys = found.setdefault(tuple(address.split()), set())
        wanted = map(_Column.parsed, _split(columns))
        keys.update(*((one.key, *one.by) for one in wanted), _conditions("".join(chosen)))
    return found


def _a_line_a_row(figures: Figures) -> str:
    """Return the figures as JSON whose innermost lists and objects take one line each."""
    text = json.dumps(figures, indent=1, ensure_ascii=False, allow_nan=False)
    inner = re.compile(r"[{[][^][{}]*[]}]")
    return inner.sub(lambda found: re.sub(r"\n\s*", " ", found[0]), text) + "\n"


def _is_chosen(row: Mapping[str, Any], conditions: Mapping[str, str]) -> bool:
    return all(str(row.get(key)) in values.split(",") for key, values in conditions.items())


def _conditions(words: str) -> dict[str, str]:
    """Return the values by key that rows are chosen by; values may have spaces."""
    return dict(re.findall(r"(\w+)=(.*?)(?=\s+\w+=|$)", words))


if __name__ == "__main__":
    main(sys.argv[1:])
