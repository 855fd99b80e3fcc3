"""``flametomo`` as a whole: its verbs, its version, its help, its start-up."""

from configparser import ConfigParser
from pathlib import Path

import pytest
from typer.testing import CliRunner

from tomo.cli.app import VERBS, app

ROOT = Path(__file__).parents[3]
TOOLS = ROOT / "tools"


def run(*arguments, columns=80):
    return CliRunner().invoke(app, [*map(str, arguments)], env={"COLUMNS": str(columns)})


def test_alone_it_lists_the_verbs_with_a_line_each():
    done, helped = run(), run("--help")
    assert done.exit_code == helped.exit_code == 0
    assert done.stdout.rstrip() == helped.stdout.rstrip()
    for verb, about in VERBS.items():
        (line,) = [line for line in done.stdout.splitlines() if line.startswith(f"  {verb} ")]
        assert line.split(maxsplit=1)[1] in about


def test_the_version_is_that_of_the_distribution():
    config = ConfigParser()
    config.read(ROOT / "setup.cfg")
    assert run("--version").stdout == f"flametomo {config['metadata']['version']}\n"


@pytest.mark.parametrize(
    ("verb", "words"),
    [("reconstrukt", "did you mean reconstruct?"), ("foo", "expected one of demo, simulate, ")],
)
def test_an_unknown_verb_is_one_line(verb, words):
    done = run(verb, "scan")
    assert done.exit_code == 2
    (line,) = done.stderr.splitlines()
    assert line.startswith(f"error: verb: found {verb!r}, {words}")


@pytest.mark.parametrize("verb", VERBS)
def test_help_fits_80_columns_cuts_no_name_and_has_an_example(verb):
    done = run(verb, "--help")
    assert done.exit_code == 0
    text = done.stdout
    assert max(map(len, text.splitlines())) <= 80
    assert VERBS[verb] in " ".join(text.split())
    assert "..." not in text
    assert "\u2026" not in text
    assert text.startswith(f"Usage: flametomo {verb} [OPTIONS]")
    assert f"    flametomo {verb} " in text.split("Examples:")[1]


@pytest.mark.parametrize("verb", VERBS)
def test_a_file_in_tools_is_the_same_program(verb):
    path = TOOLS / f"{verb.replace('-', '_')}.py"
    if verb == "demo":
        assert not path.exists()  # tools/demo.sh is more than the verb
        return
    text = path.read_text("utf-8")
    assert len([line for line in text.splitlines() if line]) <= 5
    assert f'main("{verb}")' in text


def test_the_installed_command_is_the_same_function():
    config = ConfigParser()
    config.read(ROOT / "setup.cfg")
    scripts = config["options.entry_points"]["console_scripts"]
    assert scripts.split() == ["flametomo", "=", "tomo.cli:main"]
