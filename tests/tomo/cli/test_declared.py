"""Options are named once: fields, ``--help`` and report.json's settings are equal."""

import dataclasses
import json
import re

from typer.testing import CliRunner

from phantoms import create
from rigs import ring
from tomo import VoxelGrid
from tomo.cli.declared import declared_from, with_options_of
from tomo.cli.usage import command_line
from tomo.pipeline import Options
from tomo.pipeline.checks import number, switch
from tomo.pipeline.declared import option
from tomo.simulation import simulate_images

OWN = {"out", "rig", "images", "grid", "spacing", "center", "lower", "upper", "scale"}
OWN |= {"pattern", "bayer", "channel", "workers", "scheduler", "pictures", "json", "help"}
OWN |= {"dark", "flat", "gain", "mask", "saturation", "bit_depth"}


def names_in(help_text):
    flags = re.findall(r"^  (?:-\w, )?--([a-z-]+)", help_text, re.MULTILINE)
    return [flag.replace("-", "_") for flag in flags]


def test_fields_help_and_settings_of_the_report_are_equal(run_tool, tmp_path):
    fields = {field.name for field in dataclasses.fields(Options)}
    listed = names_in(run_tool("reconstruct", "--help").stdout)
    assert len(listed) == len(set(listed))
    assert set(listed) - OWN == fields
    assert not OWN & fields
    grid = VoxelGrid((6, 10, 6), 1.0)
    rig = ring(4, 60.0, 100.0, image_size=(12, 18), footprint=0.8)
    simulate_images(rig, create("blobs", 1, grid.extent, grid.center), grid).save(
        tmp_path / "scan"
    )
    out = tmp_path / "out"
    quick = ("--method", "sirt", "--iterations", "2", "--no-pictures")
    assert run_tool("reconstruct", tmp_path / "scan", *quick, "-o", out).exit_code == 0
    settings = json.loads((out / "report.json").read_text("utf-8"))["settings"]
    assert set(settings) == fields
    assert Options.from_mapping(settings) == Options(method="sirt", iterations=2)
    assert not list(out.glob("*.png"))
    assert "data:image/png" not in (out / "report.html").read_text("utf-8")


def test_a_new_option_touches_one_declaration():
    @dataclasses.dataclass(frozen=True)
    class More(Options):
        strength_of_new: float | None = option(
            None, "A new prior's strength.", number(above=0, optional=True), metavar="STRENGTH"
        )
        is_new: bool = option(True, "Whether it is new.", switch(), topic="New")

    found = []

    @with_options_of(More)
    def command(**values):
        found.append(declared_from(More, values))

    app = command_line(command, "more")
    text = CliRunner().invoke(app, ["--help"]).stdout
    assert "--strength-of-new STRENGTH" in text
    assert "--is-new / --no-is-new" in text
    arguments = ["--strength-of-new", "2.5", "--no-is-new", "--hold-out", "a", "--hold-out", "b"]
    assert CliRunner().invoke(app, arguments).exit_code == 0
    assert CliRunner().invoke(app, []).exit_code == 0
    assert found[0] == More(strength_of_new=2.5, is_new=False, hold_out=("a", "b"))
    assert found[1] == More()
    failed = CliRunner().invoke(app, ["--strength-of-new", "-1"])
    assert str(failed.exception) == "--strength-of-new: found '-1', expected a number above 0"
