"""Wrong options and arguments: one line that names the option, exit code 2."""

from pathlib import Path

import pytest

TOOLS = Path(__file__).parents[2] / "tools"
COMMANDS = sorted(
    path.stem for path in TOOLS.glob("*.py") if "typer.Typer" in path.read_text("utf-8")
)


def _the_one_line(done):
    assert done.exit_code == 2, done.exception
    assert done.stdout == ""
    (line,) = done.stderr.splitlines()
    assert line.startswith("error: ")
    return line


@pytest.mark.parametrize("tool", COMMANDS)
def test_every_command_refuses_an_unknown_option_in_one_line(run_tool, tool):
    line = _the_one_line(run_tool(tool, "--no-such-thing"))
    assert "--no-such-thing" in line
    assert line.endswith(" --help")


@pytest.mark.parametrize(
    ("tool", "arguments", "words"),
    [
        ("reconstruct", (), "--out: missing, expected: The folder to write"),
        (
            "reconstruct",
            ("-o", "x", "--scale", "0"),
            "--scale: found '0', expected a number from 1;",
        ),
        (
            "reconstruct",
            ("-o", "x", "--seed", "abc"),
            "--seed: found 'abc', expected a whole number;",
        ),
        ("reconstruct", ("-o", "x", "--seed", "a\nb"), "--seed: found "),
        ("reconstruct", ("-o",), "'-o' requires an argument"),
        ("reconstruct", ("one", "two", "-o", "x"), "extra argument"),
        ("convert_rig", (), "IN: missing, expected: The rig to read"),
    ],
)
def test_the_line_names_the_option_what_was_found_and_expected(run_tool, tool, arguments, words):
    assert words in _the_one_line(run_tool(tool, *arguments))


def test_help_is_still_help(run_tool):
    done = run_tool("reconstruct", "--help")
    assert done.exit_code == 0
    assert "--hold-out" in done.stdout
