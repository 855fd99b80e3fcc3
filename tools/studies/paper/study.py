"""The command: rows one by one into one JSON, and the page and pictures of those that are done."""

from __future__ import annotations

import json as json_library
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Annotated, Any

import typer

from rigs.files import atomic_path
from rigs.files.json_file import plain, write_json
from rigs.progress import progress_of
from studies.common.machine import machine
from studies.common.page import markdown, significant
from studies.paper.claims import CLAIMS
from studies.paper.pictures import draw, pictures_of
from studies.paper.rows import HALF, PARTS, READING_EPOCHS, ROWS, TINY, Row
from studies.paper.training import measured_row
from tomo.cli.console import bad_input_in_one_line, print_json, say
from tomo.cli.inputs import check_output_folder
from tomo.report.about import commit

VERSION = 4
SIZES = ("full", "quick", "tiny")

_REACHED = "epochs cosine_distance best_cosine_distance best_epoch nrmse core_seconds_per_epoch"
COLUMNS = {
    "layouts": f"row layout rays segments {_REACHED} commit",
    "views": f"row layout rays {_REACHED} commit",
    "ablation": f"row variant normalise_gradient seed {_REACHED} commit",
    "noise": f"row rays_per_step relaxation sweeps {_REACHED} commit",
    "transfer": f"row encoder_of flame frozen {_REACHED} commit",
    "readings": f"row steps_per_epoch {_REACHED} commit",
}


def run(
    out: Annotated[Path, typer.Option("--out", "-o", help="The folder to write.")],
    row: Annotated[
        list[str] | None,
        typer.Option(metavar="NAME", help="A row of the page, with those it needs; repeatable."),
    ] = None,
    part: Annotated[
        list[str] | None,
        typer.Option(metavar="PART", help=f"{', '.join(PARTS)}; repeatable. All if absent."),
    ] = None,
    quick: Annotated[
        bool, typer.Option("--quick", help="Half the voxels along each axis, 10 epochs.")
    ] = False,
    json: Annotated[bool, typer.Option("--json", help="Print the rows.")] = False,
) -> None:
    """Run the experiments of the WERNet paper again, and say what holds.

    Each row is kept in OUT/paper.json as soon as it is done; the same command goes on with those
    that are not.
    """
    with bad_input_in_one_line():
        _check_known("--row", row or (), ROWS)
        _check_known("--part", part or (), PARTS)
        check_output_folder(out)
        wanted = [
            one for one in ROWS.values()
            if not (row or part) or one.name in (row or ()) or one.part in (part or ())
        ]  # fmt: skip
        result = run_rows(wanted, out, SIZES[quick])
    say(str(out / "paper.md"))
    if json:
        print_json(result)


def run_rows(wanted: Iterable[Row], out: Path, size: str) -> dict[str, Any]:
    """Do those rows that are wanted, or needed by them, and not done yet; return the result.

    Raises
    ------
    ValueError
        If the folder holds the rows of another size or version.
    """
    path = out / "paper.json"
    result = _kept(path, size)
    for row in _with_sources(wanted):
        if row.name in result["rows"]:
            continue
        with progress_of(True, row.part) as progress:
            record = measured_row(_of_size(row, size), out, progress)
        host = {key: machine()[key] for key in ("cpu", "cores")}
        record |= {"command": row.command, "commit": commit() or "unknown", **host}
        result["rows"][row.name] = plain(record, digits=6)
        write_json(path, result, indent=1)
        write_page(result, out, row.part)
        say(f"{row.name}: {significant(record['cosine_distance'])}, {record['seconds']:.0f} s")
    return result


def write_page(result: Mapping[str, Any], out: Path, changed: str) -> None:
    """Write ``paper.md`` from the rows that are done, and the picture of the part that changed."""
    rows = {name: result["rows"][name] for name in ROWS if name in result["rows"]}
    lines = ["# The WERNet paper, run again", "", f"Size {result['size']}. {len(rows)} rows of "
             f"{len(ROWS)} are done.", "", "## Claims", ""]  # fmt: skip
    lines += [markdown([claim.row(rows) for claim in CLAIMS])]
    for part, title in PARTS.items():
        done = [{"row": n, **r} for n, r in rows.items() if ROWS[n].part == part]
        if not done:
            continue
        lines += ["", f"## {title}", "", markdown(done, COLUMNS[part]), ""]
        lines += [f"    {record['command']}" for record in done]
        if part == changed:
            draw(part, {name: _of_size(ROWS[name], result["size"]) for name in rows}, rows, out)
        for picture in pictures_of(part):
            if (out / picture).is_file():
                lines += ["", f"![{title}]({picture})"]
    with atomic_path(out / "paper.md") as temporary:
        temporary.write_text("\n".join(lines) + "\n", "utf-8")


def _with_sources(rows: Iterable[Row]) -> list[Row]:
    """Return the rows, each behind the one whose encoder it starts from."""
    ordered: dict[str, Row] = {}
    for row in rows:
        if row.encoder_of:
            ordered.setdefault(row.encoder_of, ROWS[row.encoder_of])
        ordered.setdefault(row.name, row)
    return list(ordered.values())


def _of_size(row: Row, size: str) -> Row:
    if size == "full":
        return row
    grid, epochs = (HALF, READING_EPOCHS) if size == "quick" else (TINY, 2)
    return replace(row, grid=grid, epochs=min(row.epochs, epochs))


def _kept(path: Path, size: str) -> dict[str, Any]:
    """Return what an earlier run left, to go on from it."""
    fresh = {"study": "paper", "version": VERSION, "size": size, "rows": {}}
    if not path.is_file():
        return fresh
    try:
        found = json_library.loads(path.read_text("utf-8"))
        found["rows"] = {name: found["rows"][name] for name in ROWS if name in found["rows"]}
    except (ValueError, KeyError, TypeError):
        raise ValueError(f"{path}: found no rows, expected those of an earlier run") from None
    for key in ("study", "version", "size"):
        if found.get(key) != fresh[key]:
            raise ValueError(f"{path}: {key}: found {found.get(key)!r}, expected {fresh[key]!r}")
    return found


def _check_known(option: str, names: Sequence[str], known: Mapping[str, Any]) -> None:
    for name in names:
        if name not in known:
            raise ValueError(f"{option}: found {name!r}, expected one of {', '.join(known)}")
