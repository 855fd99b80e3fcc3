"""Times of films against each other."""

import numpy as np

from rigs.recordings.recording import OffBeat, off_beat

BEAT = np.arange(20) / 500
PERIODS = dict.fromkeys("abcd", 1 / 500)


def test_films_of_one_beat_agree_within_half_a_frame():
    jitter = np.random.default_rng(0).uniform(-4e-4, 4e-4, (4, 20))
    assert off_beat(dict(zip("abcd", BEAT + jitter, strict=True)), PERIODS) == []
    assert off_beat({"a": BEAT}, PERIODS) == []
    assert off_beat({"a": BEAT[:0], "b": BEAT[:0]}, PERIODS) == []


def test_a_film_that_is_late_or_early_is_found_among_others():
    times = {"a": BEAT, "b": BEAT + 0.006, "c": BEAT, "d": BEAT}
    assert off_beat(times, PERIODS) == [OffBeat("b", 3)]
    assert off_beat({"a": BEAT, "b": BEAT - 0.004}, PERIODS) == [OffBeat("b", -2)]


def test_lost_frames_and_other_rates_are_told_from_offsets():
    lost = np.delete(np.arange(21), 12) / 500
    assert off_beat({"a": BEAT, "b": lost, "c": BEAT}, PERIODS) == [OffBeat("b", 0, 12)]
    slow = {"a": BEAT, "b": BEAT * 1.5}
    (found,) = off_beat(slow, PERIODS | {"b": 1.5 / 500})
    assert found.camera == "b"
    assert found.where is not None
