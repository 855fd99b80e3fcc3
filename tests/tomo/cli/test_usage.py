"""Wrong options and arguments: one line that names the option, exit code 2."""

import pytest

from tomo.cli.app import VERBS


def _the_one_line(done):
    assert done.exit_code == 2, done.exception
    assert done.stdout == ""
    (line,) = done.stderr.splitlines()
    assert line.startswith("error: ")
    return line


@pytest.mark.parametrize("tool", VERBS)
def test_every_command_refuses_an_unknown_option_in_one_line(run_tool, tool):
    line = _the_one_line(run_tool(tool, "--no-such-thing"))
    assert "--no-such-thing" in line
    assert line.endswith(" --help")


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ((), "--out: missing, expected: The folder to write"),
        (("-o", "x", "--seed", "a\nb"), "--seed: found "),
        (("-o",), "'-o' requires an argument"),
        (("one", "two", "-o", "x"), "extra argument"),
    ],
)
def test_the_line_names_the_option_what_was_found_and_expected(run_tool, arguments, words):
    assert words in _the_one_line(run_tool("reconstruct", *arguments))


@pytest.mark.parametrize(
    ("tool", "arguments", "words"),
    [
        *(
            (
                "calibrate_rig",
                ("{}/images", "--target", "chessboard:4x3:1", "-o", "{}/rig.yaml", *options),
                words,
            )
            for options, words in (
                (("--model", "foo"), "distortion: found 'foo', expected one of auto"),
                (("--length-unit", ""), "length_unit: found '', expected a unit"),
                (
                    ("--world", "c"),
                    "world: found 'c', expected the name of a camera",
                ),
                (("--rescale",), "rescale: found True, expected world to give positions"),
                (("--cache", "{}/folder"), "folder: is a folder, expected a file to write"),
            )
        ),
    ],
)
def test_wrong_names_are_refused_before_the_work(run_tool, tmp_path, tool, arguments, words):
    for folder in ("folder", "folder.png", "images/a", "images/b"):
        (tmp_path / folder).mkdir(parents=True)
    (tmp_path / "file").write_text("mine")
    for camera in "ab":  # no images at all: reading them would say so
        (tmp_path / "images" / camera / "0.png").write_text("no image")
    line = _the_one_line(run_tool(tool, *(text.format(tmp_path) for text in arguments)))
    assert words in line
