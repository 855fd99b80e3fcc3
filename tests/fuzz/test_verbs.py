"""A sample of damaged files through the commands; `verbs` runs as many as there is time for."""

import logging

import pytest
from verbs import cases, forget_peak, peak_memory, run, tried

MOST_MEMORY = 1 << 30  # bytes beyond what valid input takes
FEW = {"converted": 2, "checked": 2, "reconstructed": 1}
"""Damaged files of each case of a verb, in the tests."""


@pytest.fixture(scope="module")
def every_case(tmp_path_factory):
    logging.disable()
    yield cases(tmp_path_factory.mktemp("samples"))
    logging.disable(logging.NOTSET)


@pytest.mark.parametrize("verb", FEW)
def test_damaged_files_end_commands_in_one_line_or_are_used(every_case, tmp_path, verb):
    chosen = {name: case for name, case in every_case.items() if verb in name}
    assert chosen
    if verb == "converted":  # about a hundred: every sixth
        chosen = dict(list(chosen.items())[::6])
    folder = tmp_path / "run"
    valid = next(iter(chosen.values()))
    assert not run(valid, valid.samples[0], folder).trace  # imports and compiles
    forget_peak()
    floor = peak_memory()
    for name, case in chosen.items():

        def tell(content, outcome, name=name):
            assert not outcome.trace, (name, content[:2000])
            assert not outcome.strays, (name, content[:2000])
            assert outcome.code in (0, 1, 2)
            if outcome.code:
                assert outcome.said.count("error: ") == 1, (name, outcome.said)

        tried(case, folder, FEW[verb], 0, tell)
        assert peak_memory() - floor < MOST_MEMORY, name
