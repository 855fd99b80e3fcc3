"""The tables of README and docs/results: ``python tools/studies/figures.py [RUN ...]``.

A ``RUN`` is the JSON that a study wrote, such as out/benchmark/benchmark.json. Its parts go into
docs/results/figures.json, in place of those that were there; then every table is written anew.

A page says where a table stands, which columns of which table it has, and which of its rows::

    <!-- figures: benchmark accuracy accuracy; flame views noise nrmse; flame=jet views=33,11 -->
    <!-- end of figures -->
"""

from __future__ import annotations

import json
import re
import sys
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[2]
if __name__ == "__main__":
    sys.path[:0] = [str(ROOT), str(ROOT / "tools")]

from rigs.files import atomic_path  # noqa: E402
from rigs.files.text import write_json  # noqa: E402
from studies.common.fingerprint import hash_of  # noqa: E402
from studies.common.page import markdown  # noqa: E402

FIGURES = ROOT / "docs/results/figures.json"
PLACE = re.compile(r"(<!-- figures: ([^>]*?) -->\n).*?(<!-- end of figures -->)", re.DOTALL)
OF_A_RUN = ("commit", "default", "machine", "size", "seed", "version")

Figures = Mapping[str, Mapping[str, Any]]


def pages(root: Path = ROOT) -> list[Path]:
    """Return the files that may have tables."""
    return [root / "README.md", *sorted((root / "docs/results").glob("*.md"))]


def with_run(figures: Figures, run: Mapping[str, Any]) -> dict[str, Any]:
    """Return the figures with the parts of a run in place of those that were there."""
    study = run["study"]
    origin = {key: run[key] for key in OF_A_RUN}
    parts = {name: {**record, **origin} for name, record in run["parts"].items()}
    return {**figures, study: {**figures.get(study, {}), **parts}}


def with_tables(text: str, figures: Figures, where: str) -> str:
    """Return a page with its tables as the figures have them.

    Raises
    ------
    ValueError
        If a table, a column or a row is not there.
    """

    def filled(place: re.Match) -> str:
        address, columns, *chosen = (part.strip() for part in place[2].split(";"))
        study, part, table = address.split()
        try:
            record = figures[study][part]
            rows = [row for row in record["tables"][table] if _is_chosen(row, "".join(chosen))]
            missing = [key for key in columns.split() if key not in rows[0]]
        except (KeyError, IndexError):
            raise ValueError(f"{where}: no rows of {place[2]!r} in {FIGURES.name}") from None
        if missing:
            raise ValueError(f"{where}: {address}: found no column {missing[0]}")
        cpu, cores = (record["machine"][key] for key in ("cpu", "cores"))
        made = f"Commit {record['commit']}; {cpu}, {cores} cores."
        return f"{place[1]}{markdown(rows, columns)}\n\n{made}\n{place[3]}"

    return PLACE.sub(filled, text)


def stale(figures: Figures) -> list[str]:
    """Return a line for each part that was measured with another default than the tree's."""
    lines, known = [], {}
    for study, parts in figures.items():
        for part, record in parts.items():
            of_run = record["default"]["hash"]
            if of_run not in known:
                known[of_run] = hash_of(record["default"]["modules"])
            if known[of_run] != of_run:
                again = record.get("command", f"python tools/{study}.py --part {part}")
                lines.append(
                    f"{FIGURES.name}: {study} {part}: measured at {record['commit']}, the default "
                    f"has changed since; repeat: {again} "
                    f"-o out/{study} && python tools/studies/figures.py out/{study}/{study}.json"
                )
    return lines


def main(runs: Iterable[str]) -> None:
    """Take runs into the figures, and write the tables of all pages."""
    figures = json.loads(FIGURES.read_text("utf-8")) if FIGURES.is_file() else {}
    for path in runs:
        figures = with_run(figures, json.loads(Path(path).read_text("utf-8")))
    written = {page: with_tables(page.read_text("utf-8"), figures, page.name) for page in pages()}
    write_json(FIGURES, figures, indent=1)
    for page, text in written.items():
        with atomic_path(page) as temporary:
            temporary.write_text(text, "utf-8")


def _is_chosen(row: Mapping[str, Any], conditions: str) -> bool:
    wanted = dict(condition.split("=", 1) for condition in conditions.split())
    return all(str(row[key]) in values.split(",") for key, values in wanted.items())


if __name__ == "__main__":
    main(sys.argv[1:])
