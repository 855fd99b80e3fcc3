"""One command for every study: parts measured one by one; JSON, a page of tables, and plots."""

import time
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from importlib import import_module
from inspect import getdoc
from pathlib import Path
from types import ModuleType
from typing import Annotated, Any, TypeVar

import typer

from rigs.progress import progress_of
from studies.common.processes import MOST
from tomo.cli.console import bad_input_in_one_line, print_json, say
from tomo.cli.declared import command_line
from tomo.cli.inputs import check_output_folder

Progress = Callable[[int, int, str], None]  # ``progress(done, total, what)``
Tables = dict[str, list[dict[str, Any]]]  # rows of plain data, by the name of their table
T = TypeVar("T")
VERSION = 3


def _silent(done: int, total: int, what: str) -> None:
    """Report nothing."""


@dataclass(frozen=True)
class Request:
    """What a part is asked for."""

    size: str = "full"  # how much: ``full``, ``quick``, ``tiny``, or another of the study's sizes
    seed: int = 0  # of everything random
    data: Path | None = None  # a folder of real image sets
    device: str = "cuda"  # the GPU of parts that need one
    progress: Progress = field(default=_silent, compare=False)

    def each(self, cases: Iterable[T], words: Callable[[T], str]) -> Iterator[T]:
        """Yield cases, each after its words were said as progress."""
        cases = list(cases)
        for number, case in enumerate(cases):
            self.progress(number, len(cases), words(case))
            yield case


@dataclass(frozen=True)
class Study:
    """A study and its parts."""

    name: str  # of its files: ``NAME.json``, ``NAME.md`` and plots in ``NAME/``
    title: str
    # title and module of each part, in their order. The module has the function ``run``, or the
    # one named behind a colon, which takes a `Request` and returns what ``gather`` makes `Tables`
    # of; maybe ``PLOTS``, for each picture a function from the tables to the arguments of
    # `studies.common.axes.curves`; and maybe ``check``, which refuses a request by a ValueError.
    # The docstring, of module or function, stands on the page
    parts: Mapping[str, tuple[str, str]]
    sizes: tuple[str, ...] = ("full", "quick", "tiny")
    gather: Callable[[Any], Tables] = dict
    # parts whose figures other work does not change, in the order in which they begin: they run at
    # the same time, in processes of one thread each, after the others
    together: tuple[str, ...] = ()

    def module(self, part: str) -> ModuleType:
        """Return the module of a part."""
        return import_module(self.parts[part][1].partition(":")[0])

    def measure(self, part: str, request: Request) -> Tables:
        """Run a part."""
        function = self.parts[part][1].partition(":")[2] or "run"
        return self.gather(getattr(self.module(part), function)(request))

    def about(self, part: str) -> str:
        """Return what the docstring of a part says, in one line."""
        module, function = self.module(part), self.parts[part][1].partition(":")[2]
        return " ".join(getdoc(getattr(module, function) if function else module).split())


def command(study: Study) -> typer.Typer:
    """Return the study's command line."""

    def run(
        out: Annotated[Path, typer.Option("--out", "-o", help="The folder to write.")],
        size: Annotated[
            str, typer.Option(help=f"How much of it: {', '.join(study.sizes)}.")
        ] = study.sizes[0],
        part: Annotated[
            list[str] | None,
            typer.Option(help=f"{', '.join(study.parts)}; may be repeated. All if absent."),
        ] = None,
        resume: Annotated[
            bool, typer.Option("--resume", help="Keep the parts that the folder holds already.")
        ] = False,
        data: Annotated[
            Path | None,
            typer.Option(envvar="TOMO_TEST_DATA", help="A folder of real image sets."),
        ] = None,
        seed: Annotated[
            int, typer.Option(help="Of what is random in the parts that take one.", min=0)
        ] = 0,
        device: Annotated[
            str,
            typer.Option(
                help="The GPU of the parts that need one: cuda or cuda:N.",
                hidden="gpu" not in study.parts,
            ),
        ] = Request.device,
        processes: Annotated[
            int,
            typer.Option(
                help="How many parts without wall times run at once, each on one thread; "
                "1: one after the other, on all threads.",
                min=1,
                hidden=not study.together,
            ),
        ] = MOST,
        json: Annotated[bool, typer.Option("--json", help="Print the tables.")] = False,
    ) -> None:
        with bad_input_in_one_line():
            check_known("--size", [size], study.sizes)
            check_known("--part", part or (), study.parts)
            if data is not None and not data.is_dir():
                raise FileNotFoundError(f"--data: {data}: no such folder")
            check_output_folder(out)
            from studies.common.results import fresh_run, kept_run

            request = Request(size, seed, data, device)
            for name in part or ():
                getattr(study.module(name), "check", _accept)(request)
            result = fresh_run(study.name, VERSION, request)
            if resume:
                result = kept_run(out / f"{study.name}.json", result)
        missed = _measure(study, request, result, out, part, processes)
        if json:
            print_json({"page": str(out / f"{study.name}.md"), "parts": result["parts"]})
        if missed:
            raise typer.Exit(1)

    return command_line(run, study.name, help=study.title)


def _measure(
    study: Study,
    request: Request,
    result: dict[str, Any],
    out: Path,
    wanted: Iterable[str] | None,
    processes: int,
) -> int:
    """Run the parts that are wanted and not there yet; return how many rows do not hold."""
    from rigs.files.text import write_json, write_text
    from studies.common.page import page

    kept = dict(result["parts"])
    missing = [name for name in dict.fromkeys(wanted or study.parts) if name not in kept]
    for name, record in _records(study, request, out, missing, processes):
        kept[name] = record
        result["parts"] = {key: kept[key] for key in study.parts if key in kept}
        write_json(out / f"{study.name}.json", result, indent=1)
        write_text(out / f"{study.name}.md", page(study, result))
        say(f"{name}: {record['seconds']:.0f} s")
    rows = [r for p in result["parts"].values() for table in p["tables"].values() for r in table]
    missed = sum(row.get("holds") is False for row in rows)
    if any("holds" in row for row in rows):
        say(f"{len(rows) - missed} of {len(rows)} rows hold")
    say(str(out / f"{study.name}.md"))
    return missed


def _records(
    study: Study, request: Request, out: Path, names: Iterable[str], processes: int
) -> Iterator[tuple[str, dict[str, Any]]]:
    """Yield parts and what was measured as they are done, first those that run alone."""
    from studies.common.processes import at_work

    together = []
    for name in names:
        try:
            getattr(study.module(name), "check", _accept)(request)
        except ValueError as error:
            say(f"{name}: left out: {error}")
            continue
        if name in study.together and processes > 1:
            together.append(name)
        else:
            yield name, measured(study, name, request, out)
    jobs = {name: (study, name, request, out) for name in study.together if name in together}
    yield from at_work(measured, jobs, processes)


def measured(study: Study, name: str, request: Request, out: Path) -> dict[str, Any]:
    """Run a part and draw its pictures; return its tables and its cost."""
    from rigs.files.text import plain
    from studies.common.results import cpu_seconds, load

    module, loaded = study.module(name), load()
    started, busy = time.perf_counter(), cpu_seconds()
    with progress_of(True, name) as progress:
        tables = study.measure(name, replace(request, progress=progress))
    record = {"seconds": time.perf_counter() - started, "load_at_start": loaded}
    record["cpu_seconds"] = cpu_seconds() - busy
    record["pictures"] = _draw(module, tables, out, study.name)
    return record | {"tables": plain(_stored(tables), digits=5)}


def _accept(request: Request) -> None:
    """Refuse nothing."""


def _stored(tables: Tables) -> Tables:
    """Return the rows without their curves, which are drawn."""
    return {
        name: [{key: value for key, value in row.items() if key != "curves"} for row in rows]
        for name, rows in tables.items()
    }


def _draw(module: ModuleType, tables: Tables, out: Path, name: str) -> list[str]:
    """Write the pictures of a part; return their paths in the folder."""
    from studies.common.axes import curves
    from tomo.draw.figures import save_figure

    drawn = []
    for picture, panels_of in getattr(module, "PLOTS", {}).items():
        panels, *words = panels_of(tables)
        if panels:
            drawn.append(f"{name}/{picture}.png")
            save_figure(curves(panels, *words), out / drawn[-1])
    return drawn


def check_known(option: str, names: Iterable[str], known: Iterable[str]) -> None:
    """Refuse a value of an option that is not known."""
    for name in names:
        if name not in known:
            raise ValueError(f"{option}: found {name!r}, expected one of {', '.join(known)}")
