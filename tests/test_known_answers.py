"""The default on known scenes: a change of what it answers is a change of known_answers.json."""

import sys
from pathlib import Path

import pytest

sys.path.append(str(Path(__file__).parents[1] / "tools"))

from studies import known_answers

KNOWN = known_answers.read_answers()
IN_THE_SUITE = list(KNOWN["scenes"])[:3]  # the smallest; the release checklist has all


@pytest.mark.parametrize("name", IN_THE_SUITE)
def test_the_default_answers_as_it_did_when_it_was_settled(name):
    entry = KNOWN["scenes"][name]
    found = known_answers.of_scene(entry["recipe"])
    assert not known_answers.differences(entry["answer"], found)


def test_what_is_known_names_twelve_scenes_and_all_real_sets():
    assert len(KNOWN["scenes"]) == 12
    assert set(KNOWN["real"]) == set(known_answers.REAL)


@pytest.mark.parametrize(
    ("change", "words"),
    [({"nrmse": 0.0511}, "nrmse"), ({"verdict": "red"}, "verdict"), ({"named": []}, "named")],
)
def test_a_change_is_told(change, words):
    known = {"nrmse": 0.05, "verdict": "green", "named": ["gain left"], "bits": "a"}
    (line,) = known_answers.differences(known, known | change)
    assert line.startswith(words)
    assert not known_answers.differences(known, known | {"nrmse": 0.0504, "bits": "b"})
