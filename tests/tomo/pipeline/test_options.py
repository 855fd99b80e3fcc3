"""Options: each declared once; the report's settings and the documentation follow."""

import json
from dataclasses import fields

import numpy as np
import pytest

from tomo import Options, load_scan, operators
from tomo.io import write_volume
from tomo.pipeline import options as declared
from tomo.pipeline import reconstruct
from tomo.trace import TRACERS

NAMES = [option.name for option in fields(Options)]


def test_the_settings_of_a_report_are_the_options(outcome):
    settings = json.loads(json.dumps(outcome.report(), allow_nan=False))["settings"]
    assert list(settings) == NAMES
    assert Options.from_mapping(settings) == outcome.options


def test_stored_options_come_back():
    options = Options(
        method="wernet",
        hold_out=["cam01", "cam02"],
        compare=["sirt:20", "mlem"],
        carving="7.5",
        refine_cameras="cam03, cam04",
        time_limit=3,
        uncertainty="5",
    )
    assert options.carving == 7.5
    assert options.refine_cameras == ("cam03", "cam04")
    assert options.uncertainty == 5
    stored = json.loads(json.dumps(options.to_mapping()))
    assert Options.from_mapping(stored) == options
    assert Options.from_mapping({}) == Options()


def test_every_option_is_documented_where_it_is_declared():
    for option in fields(Options):
        assert len(option.metadata["help"]) > 20
        assert option.metadata["check"].convert(option.default) == option.default
        assert f"\n    {option.name} : " in Options.__doc__


def test_words_are_those_of_the_parts_they_name():
    assert declared.TRACERS == TRACERS
    assert declared.BASES == (operators.VOXEL, operators.LINEAR)
    assert declared.PROJECTORS[1:] == (operators.STORED, operators.ON_THE_FLY)


@pytest.mark.parametrize(
    ("settings", "words"),
    [
        ({"method": "magic"}, "method: found 'magic', expected one of auto, art"),
        ({"method": "curvatur"}, r"method: found 'curvatur', did you mean curvature\?"),
        ({"iterations": 2.5}, "iterations: found 2.5, expected a whole number >= 0"),
        ({"iterations": True}, "iterations: found True"),
        ({"supersample": 0}, "supersample: found 0, expected a whole number from 1 to 64"),
        ({"carving": "much"}, "carving: found 'much', expected auto, off or a number >= 0"),
        ({"blur": -1}, "blur: found -1, expected a number >= 0"),
        ({"skip": "maybe"}, "skip: found 'maybe', expected True or False"),
        ({"hold_out": [3]}, r"hold_out: found \[3\], expected names of cameras"),
        ({"compare": ["auto"]}, r"compare: found \['auto'\], expected METHOD or METHOD:ITER"),
        *(
            ({"compare": [one]}, "compare: found .*, of the methods art")
            for one in ("foo", "sirt:", "sirt:x", "sirt:-3", "")
        ),
        ({"time_limit": "nan"}, "time_limit: found 'nan', expected a number above 0"),
        ({"time_limit": "-1"}, "time_limit: found '-1'"),
        ({"time_limit": 0}, "time_limit: found 0"),
        ({"tracer": "foo"}, "tracer: found 'foo', expected one of march"),
        ({"device": "cuda:x"}, "device: found 'cuda:x', expected cpu, auto, cuda or cuda:N"),
        ({"carving": "inf"}, "carving: found 'inf'"),
        ({"carving": -1}, "carving: found -1"),
        ({"blur": "much"}, "blur: found 'much'"),
        ({"seed": str(2**63)}, "seed: found '9223372036854775808'"),
        ({"uncertainty": 1}, "uncertainty: found 1, expected auto, 0, or 2 repeats or more"),
        ({"refine_cameras": 3}, "refine_cameras: found 3, expected names of cameras"),
        ({"seed": -1}, "seed: found -1, expected a whole number from 0 to 9223372036854775807"),
        ({"wernet_settings": 3}, "wernet_settings: found 3, expected a path"),
    ],
)
def test_a_wrong_value_names_its_option(settings, words):
    with pytest.raises(ValueError, match=f"^{words}"):
        Options(**settings)


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("weigh", "options: found 'weigh', expected one of method, frame"),
        ("holdout", r"options: found 'holdout', did you mean hold_out\?"),
    ],
)
@pytest.mark.parametrize("made", [lambda given: Options(**given), Options.from_mapping])
def test_a_name_that_is_unknown_is_refused(made, name, words):
    with pytest.raises(ValueError, match=words):
        made({name: True})


def test_the_truth_does_not_reach_the_solve(copy, grid, outcome, quick_choice, quick_solve):
    truth = np.random.default_rng(3).random(grid.shape)
    write_volume(copy / "truth.npz", truth, grid)
    found = reconstruct(load_scan(copy), options=Options(uncertainty=0))
    np.testing.assert_array_equal(found.volume, outcome.volume)
    assert found.solution.settings == outcome.solution.settings
    assert found.solution.quality != outcome.solution.quality
