"""The command: rows one by one into one JSON, and the page and pictures of those that are done."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import typer
from numpy.typing import NDArray

from rigs.files.text import plain, write_json, write_text
from rigs.progress import progress_of
from studies.common.axes import curves
from studies.common.page import markdown, significant
from studies.common.results import fresh_run, kept_run
from studies.common.study import Request, Tables, check_known
from studies.paper.cases import truth_of
from studies.paper.rows import CLAIMS, HALF, PARTS, READING_EPOCHS, ROWS, TINY, Row
from studies.paper.training import measured_row
from tomo.cli.console import bad_input_in_one_line, print_json, say
from tomo.cli.inputs import check_output_folder
from tomo.draw.figures import INK, MUTED, new_figure, save_figure, short_numbers
from tomo.draw.figures import plain as words_of

VERSION = 5
SECTIONED = ("layouts", "views", "noise")  # parts whose volumes are shown
Records = Mapping[str, Mapping[str, Any]]

SIZES = ("full", "quick")
"""In quick, every row has half the voxels along each axis and 10 epochs: some minutes."""


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
    size: Annotated[
        str, typer.Option(help="full, or quick: half the voxels along each axis, 10 epochs.")
    ] = SIZES[0],
    json: Annotated[bool, typer.Option("--json", help="Print the rows.")] = False,
) -> None:
    """Run the experiments of the WERNet paper again, and say what holds.

    Each row is kept in OUT/paper.json as soon as it is done; the same command goes on with those
    that are not.
    """
    with bad_input_in_one_line():
        check_known("--row", row or (), ROWS)
        check_known("--part", part or (), PARTS)
        check_known("--size", [size], SIZES)
        check_output_folder(out)
        wanted = [
            one for one in ROWS.values()
            if not (row or part) or one.name in (row or ()) or one.part in (part or ())
        ]  # fmt: skip
        result = run_rows(wanted, out, size)
    say(str(out / "paper.md"))
    if json:
        print_json(result)


def run_rows(wanted: Iterable[Row], out: Path, size: str) -> dict[str, Any]:
    """Do those rows that are wanted, or needed by them, and not done yet; return the result."""
    path = out / "paper.json"
    fresh = fresh_run("paper", VERSION, Request(size)) | {"rows": {}}
    result, now = kept_run(path, fresh), fresh["commit"]
    for row in _with_sources(wanted):
        if row.name in result["rows"]:
            continue
        with progress_of(True, row.part) as progress:
            record = measured_row(_of_size(row, size), out, progress)
        record |= {"command": f"{row.command} --size {size}", "commit": now}
        result["rows"][row.name] = plain(record, digits=6)
        rows = {name: result["rows"][name] for name in ROWS if name in result["rows"]}
        command = f"python tools/paper.py --size {size}"
        result["parts"] = {size: {"command": command, "tables": tables_of(rows)}}
        write_json(path, result, indent=1)
        draw(row.part, {name: _of_size(ROWS[name], size) for name in rows}, rows, out)
        write_page(result, out)
        say(f"{row.name}: {significant(record['cosine_distance'])}, {record['seconds']:.0f} s")
    return result


def tables_of(rows: Records) -> Tables:
    """Return the claims that can be judged, and each part's rows that are done."""
    judged = [claim.row(rows) for claim in CLAIMS]
    tables = {"claims": [line for line in judged if line["here"] is not None]}
    for part in PARTS:
        own = [name for name in rows if ROWS[name].part == part]
        every = dict.fromkeys(key for name in own for key in rows[name] if key != "curve")
        tables[part] = [
            {"row": name} | {key: rows[name].get(key) for key in every} for name in own
        ]
    return tables


def write_page(result: Mapping[str, Any], out: Path) -> None:
    """Write ``paper.md`` from the rows that are done."""
    (part,) = result["parts"].values()
    lines = ["# The WERNet paper, run again", "", f"Size {result['size']}. "
             f"{len(result['rows'])} rows of {len(ROWS)} are done."]  # fmt: skip
    for name, table in part["tables"].items():
        if not table:
            continue
        title = PARTS.get(name, "Claims")
        lines += ["", f"## {title}", "", markdown(table), ""]
        lines += [
            f"    {result['rows'][line['row']]['command']}" for line in table if "row" in line
        ]
        for picture in pictures_of(name):
            if (out / picture).is_file():
                lines += ["", f"![{title}]({picture})"]
    write_text(out / "paper.md", "\n".join(lines) + "\n")


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


def pictures_of(part: str) -> tuple[str, ...]:
    """Return where a part's pictures are in the output folder."""
    kinds = ("convergence", "sections") if part in SECTIONED else ("convergence",)
    return tuple(f"paper/{part}_{kind}.png" for kind in kinds)


def draw(part: str, rows: Mapping[str, Row], records: Records, out: Path) -> None:
    """Draw a part's pictures into ``out`` from rows, in the size in which they were run."""
    own = [name for name in records if ROWS[name].part == part]
    base = ["jet"] if part == "ablation" and "jet" in records else []
    panels: dict[str, dict[str, list[tuple[float, float]]]] = {}
    for name in (*base, *own):
        if not records[name]["art"]:
            points = [(epoch, distance) for epoch, distance, _ in records[name]["curve"]]
            panels.setdefault(records[name]["flame"], {})[name] = points
    first, *others = pictures_of(part)
    if panels:
        save_figure(curves(panels, "epoch", "cosine distance"), out / first)
    if others and own:
        _draw_sections({name: rows[name] for name in own}, records, out, out / others[0])


def _draw_sections(rows: Mapping[str, Row], records: Records, out: Path, path: Path) -> None:
    """Draw the middle plane of each row: the truth, the volume found, and their difference."""
    width = 2.1 * len(rows) + 1.6  # inches
    figure = new_figure(width, 4.2)
    left, right = 0.6 / width, 1 - 1.0 / width
    grid = figure.add_gridspec(1, len(rows), wspace=0.18, left=left, right=right, top=0.8)
    shown = {}
    for place, (name, row) in zip(grid, rows.items(), strict=True):
        truth = truth_of(row.flame, row.grid)
        found = np.load(out / "volumes" / f"{name}.npy", allow_pickle=False)
        parts = [np.asarray(part)[:, :, truth.shape[2] // 2].T for part in (truth, found)]
        three = place.subgridspec(1, 3, wspace=0.08).subplots(sharey=True)
        shown[name] = three, [part / truth.max() for part in (*parts, parts[1] - parts[0])]
        distance = significant(records[name]["cosine_distance"])
        title = f"{name.replace('-', ' ')}\ncosine distance {distance}"
        three[1].set_title(words_of(title), fontsize=7, color=INK, pad=16)
    largest = max(float(np.abs(images[2]).max()) for _, images in shown.values())
    for number, (name, (three, images)) in enumerate(shown.items()):
        extent = rows[name].grid.extent / 2
        looks = [("inferno", 0, 1)] * 2 + [("RdBu_r", -largest, largest)]
        words = ("truth", "found", "difference")
        for axes, image, look, word in zip(three, images, looks, words, strict=True):
            drawn = _show(axes, image, extent, *look)
            axes.text(0.5, 1.01, word, transform=axes.transAxes, fontsize=6, color=MUTED,
                      ha="center")  # fmt: skip
            axes.tick_params(left=axes is three[0])
            if number == len(shown) - 1 and axes is not three[0]:
                low = 0.12 if axes is three[2] else 0.5
                bar = figure.colorbar(
                    drawn, cax=figure.add_axes((right + 0.2 / width, low, 0.08 / width, 0.3))
                )
                bar.ax.tick_params(labelsize=6, colors=MUTED)
                bar.set_label(
                    "difference" if axes is three[2] else "emission over its maximum", fontsize=6
                )
                short_numbers(bar.ax)
    figure.supxlabel("x (mm)", fontsize=7)
    figure.supylabel("y (mm)", fontsize=7)
    save_figure(figure, path)


def _show(axes: Any, image: NDArray, extent: NDArray, colours: str, *limits: float) -> Any:
    box = (-extent[0], extent[0], -extent[1], extent[1])
    axes.tick_params(labelsize=6, colors=MUTED, labelleft=axes.get_subplotspec().is_first_col())
    return axes.imshow(
        image, cmap=colours, vmin=limits[0], vmax=limits[1], origin="lower", extent=box
    )
