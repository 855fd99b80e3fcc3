"""Wrong options and arguments: one line that names the option, exit code 2."""

import pytest

from tomo.cli.app import VERBS


@pytest.mark.parametrize("tool", VERBS)
def test_every_command_refuses_an_unknown_option_in_one_line(refused, tool):
    line = refused(tool, "--no-such-thing")
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
def test_the_line_names_the_option_what_was_found_and_expected(refused, arguments, words):
    assert words in refused("reconstruct", *arguments)


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (("--model", "foo"), "distortion: found 'foo', expected one of auto, none"),
        (("--length-unit", ""), "length_unit: found '', expected a unit"),
        (("--world", "c"), "world: found 'c', expected the name of a camera"),
        (("--rescale",), "rescale: found True, expected world to give positions"),
        (("--cache", "images"), "images: is a folder, expected a file to write"),
    ],
)
def test_wrong_names_are_refused_before_the_work(refused, tmp_path, monkeypatch, options, words):
    monkeypatch.chdir(tmp_path)
    for camera in "ab":  # no images at all: reading them would say so
        (tmp_path / "images" / camera).mkdir(parents=True)
        (tmp_path / "images" / camera / "0.png").write_text("no image")
    target = ("--target", "chessboard:4x3:1", "-o", "rig.yaml")
    assert words in refused("calibrate_rig", "images", *target, *options)
