"""The stress of threads: its rows hold, and show one bit that differs."""

from dataclasses import replace

import numpy as np
import pytest
from studies.stress.threads import Made, _scan, classic_rows, hash_of, learned_rows, made_by

from tomo.simulation.effects import Effects

VOLUME = np.arange(8, dtype=np.float32).reshape(2, 2, 2)


def _made(threads, volume=VOLUME, **hashes):
    names = {"mlem": "a", "mlem @ 1": "a", "nnls": "b"}
    return Made(threads, names | hashes, volume)


def _held(rows):
    return [row.holds for row in rows]


def test_equal_bits_hold():
    assert _held(classic_rows([_made(1), _made(2), _made(2)])) == [True, True, True]
    assert _held(learned_rows([_made(1), _made(2), _made(2)])) == [True, True]


@pytest.mark.parametrize(
    ("number", "hashes", "held"),
    [
        (1, {"nnls": "c"}, [False, True, False]),
        (0, {"mlem @ 1": "c"}, [True, False, True]),
        (2, {"nnls": "c"}, [True, True, False]),
    ],
)
def test_one_result_with_other_bits_shows(number, hashes, held):
    made = [_made(1), _made(2), _made(2)]
    made[number] = _made(made[number].threads, **hashes)
    assert _held(classic_rows(made)) == held


def test_a_learned_volume_that_differs_shows():
    nearly, far = VOLUME * np.float32(1 + 1e-5), VOLUME * np.float32(1.01)
    assert _held(learned_rows([_made(1, nearly), _made(2), _made(2)])) == [True, True]
    assert _held(learned_rows([_made(1), _made(2), _made(2, nearly)])) == [False, True]
    assert _held(learned_rows([_made(1), _made(2, far), _made(2, far)])) == [True, False]


def test_zero_and_its_negative_are_other_bits():
    assert hash_of(np.zeros(3)) != hash_of(-np.zeros(3))


def test_processes_of_one_and_three_threads_make_the_same_bits(tmp_path):
    _scan(tmp_path / "scan", 5, Effects())
    one, three = (made_by(threads, tmp_path / "scan") for threads in (1, 3))
    assert len(one.hashes) > 30
    assert {"default method", "nnls, stored", "tv, on the fly", "carving"} <= set(one.hashes)
    assert any(name.endswith("@ 2") for name in three.hashes)
    found = list(classic_rows([one, three, replace(three)]))
    assert [row.holds for row in found] == [True, True, True]


def test_a_child_that_fails_says_why(tmp_path):
    with pytest.raises(RuntimeError, match=r"threads .*nowhere"):
        made_by(1, tmp_path / "nowhere")
