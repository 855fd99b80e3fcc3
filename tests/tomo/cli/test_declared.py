"""Options are named once: fields, ``--help`` and report.json's settings are equal."""

import dataclasses
import json
import re
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated

import pytest
from typer.testing import CliRunner

from tomo.cli.declared import command_line
from tomo.pipeline import Options
from tomo.pipeline.declared import number, option, switch, whole

OWN = {"out", "rig", "images", "grid", "spacing", "center", "lower", "upper", "scale"}
OWN |= {"pattern", "bayer", "channel", "workers", "scheduler", "preview", "pictures", "json"}
OWN |= {"help"}
OWN |= {"dark", "flat", "gain", "mask", "saturation", "bit_depth"}


def names_in(help_text):
    flags = re.findall(r"^  (?:-\w, )?--([a-z-]+)", help_text, re.MULTILINE)
    return [flag.replace("-", "_") for flag in flags]


def test_fields_help_and_settings_of_the_report_are_equal(
    run_tool, original, quick, as_given, tmp_path
):
    fields = {field.name for field in dataclasses.fields(Options)}
    listed = names_in(run_tool("reconstruct", "--help").stdout)
    assert len(listed) == len(set(listed))
    assert set(listed) - OWN == fields
    assert not OWN & fields
    out = tmp_path / "out"
    assert run_tool("reconstruct", original, *quick, "-o", out).exit_code == 0
    settings = json.loads((out / "report.json").read_text("utf-8"))["settings"]
    assert set(settings) == fields
    assert Options.from_mapping(settings) == Options(method="sirt", iterations=2, **as_given)
    assert not list(out.glob("*.png"))
    assert "data:image/png" not in (out / "report.html").read_text("utf-8")


def test_the_help_begins_with_six_options_and_sorts_the_rest_by_topic(run_tool):
    text = run_tool("reconstruct", "--help").stdout
    first, rest = text.split("\nOptions:\n")[1].split("\n\n", 1)
    assert names_in(first) == ["out", "rig", "images", "grid", "spacing", "method", "help"]
    titles = re.findall(r"^(\w.*):$", rest, re.MULTILINE)
    assert {field.metadata["topic"] for field in dataclasses.fields(Options)[1:]} < set(titles)
    assert len(titles) == len(set(titles))


@dataclasses.dataclass(frozen=True)
class More(Options):
    strength_of_new: float | None = option(
        None, "A new prior's strength.", number(above=0, optional=True), metavar="STRENGTH"
    )
    is_new: bool = option(True, "Whether it is new.", switch(), topic="New")


@dataclasses.dataclass(frozen=True)
class Place:
    """Where.

    A place
    -------
    place_of : X,Y
        Where it is,
        in two lines.
    """

    place_of: str | None = None


FOUND = []


def command(
    thing: Path,
    /,
    *,
    out: Path,
    count: Annotated[int, whole(1, 9)] = 3,
    size: float | None = None,
    draws: bool = True,
    force: bool = False,
    levels: Sequence[float] | None = None,
    from_: str = "here",
    options: More,
    place: Place,
) -> None:
    """Do a thing.

    More of it.

    Parameters
    ----------
    thing : THING
        What is done.
    count : N
        How often.
    """
    FOUND.append((thing, out, count, size, draws, force, levels, from_, options, place))


def run(*arguments):
    FOUND.clear()
    return CliRunner().invoke(command_line(command, "more"), [*arguments])


def test_the_help_is_of_signature_and_docstrings():
    text = run("--help").stdout
    assert text.startswith("Usage: more [OPTIONS] THING\n\n  Do a thing.\n\n  More of it.\n")
    assert "Parameters" not in text
    assert re.search(r"^  THING  What is done\.", text, re.MULTILINE)
    assert re.search(r"--count N +How often\.  \[default: 3\]", text)
    flags = ("-o, --out FOLDER", "--draws / --no-draws", "--force", "--levels X", "--from TEXT")
    assert all(one in text for one in flags)
    assert "\nA place:\n  --place-of X,Y  Where it is, in two lines.\n" in text
    assert "--strength-of-new STRENGTH" in text
    assert re.search(r"^New:\n  --is-new / --no-is-new", text, re.MULTILINE)


def test_the_function_gets_values_and_groups():
    arguments = ["--strength-of-new", "2.5", "--no-is-new", "--hold-out", "a", "--hold-out", "b"]
    assert run("a", "-o", "b", *arguments).exit_code == 0
    assert [
        (
            Path("a"), Path("b"), 3, None, True, False, None, "here",
            More(strength_of_new=2.5, is_new=False, hold_out=("a", "b")), Place(),
        )
    ] == FOUND  # fmt: skip
    more = ("--count", "9", "--size", "-1e3", "--no-draws", "--force", "--levels", "1")
    more += ("--levels", "2", "--from", "there", "--place-of", "1,2")
    assert run("a", "-o", "b", *more).exit_code == 0
    asked = (9, -1000.0, False, True, [1.0, 2.0], "there", More(), Place("1,2"))
    assert [(Path("a"), Path("b"), *asked)] == FOUND


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ((), "THING: missing, expected: What is done"),
        (("a",), "--out: missing, expected: The folder to write"),
        (("", "-o", "b"), "THING: found '', expected a path"),
        (("a", "-o", "b", "--count", "10"), "--count: found '10', expected a whole number from 1"),
        (("a", "-o", "b", "--size", "nan"), "--size: found 'nan', expected a number"),
        (("a", "-o", "b", "--levels", "1", "--levels", "x"), "--levels: found 'x', expected a n"),
        (("a", "-o", "b", "--strength-of-new", "-1"), "--strength-of-new: found '-1', expected a"),
        (("a", "-o", "b", "--metod", "tv"), "--metod: no such option, did you mean --method?"),
        (("a", "-o", "b", "--qqq"), "--qqq: no such option; see"),
        (("a", "-o", "b", "--method", "tvv"), "--method: found 'tvv', did you mean tv?"),
    ],
)
def test_what_is_wrong_is_one_line(arguments, words):
    done = run(*arguments)
    assert done.exit_code == 2
    (line,) = done.stderr.splitlines()
    assert line.startswith(f"error: {words}")
    assert not FOUND
