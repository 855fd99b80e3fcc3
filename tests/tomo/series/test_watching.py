import numpy as np
import pytest

from tomo.series.watching import in_words, lasting_change, watch

CAMERAS = ("cam00", "cam01", "cam02")


def steady(count, seed=0, correlation=0.95):
    """Return figures that scatter, with memory, about levels that stay."""
    rng = np.random.default_rng(seed)

    def scatter(size):
        noise = rng.normal(size=(count, 3))
        for frame in range(1, count):
            noise[frame] = correlation * noise[frame - 1] + noise[frame] * np.sqrt(
                1 - correlation**2
            )
        return size * noise

    return {
        "view_light": np.array([0.95, 1.0, 1.08]) * np.exp(scatter(0.004)),
        "view_residual": 0.1 * np.exp(scatter(0.08)),
        "psnr": np.where([False, False, True], 32 + scatter(0.5), np.nan),
        "complete": np.ones(count, np.uint8),
    }


@pytest.mark.parametrize("count", [1, 10, 40, 300, 1000])
def test_steady_series_raise_no_alarm(count):
    for seed in range(10):
        assert watch(steady(count, seed), range(count), CAMERAS) == []


def test_a_gain_that_drifts_is_named_with_its_size_and_first_frame():
    table = steady(600)
    table["view_light"][300:, 1] *= 1.04
    (one,) = watch(table, range(1000, 1600), CAMERAS)
    assert (one.kind, one.camera) == ("gain", "cam01")
    assert one.size == pytest.approx(0.04, abs=0.01)
    assert abs(one.frame - 1300) <= 5
    assert one.line.startswith("cam01: gain drifts +4% from frame ")


def test_a_steady_drift_is_said_in_full():
    table = steady(400)
    table["view_light"][:, 0] *= np.linspace(1, 0.9, 400)
    (one,) = watch(table, range(400), CAMERAS)
    assert one.size == pytest.approx(-0.1, abs=0.015)
    assert 100 < one.frame < 300


def test_a_change_that_goes_back_is_none():
    values = np.ones(200)
    values[80:120] = 2
    assert lasting_change(values) is None
    assert lasting_change(np.ones(200)) is None


@pytest.mark.parametrize("spread", [0.0, 0.01])
@pytest.mark.parametrize("place", [9, 50, 91])
def test_the_place_of_a_step_is_found(place, spread):
    values = np.where(np.arange(100) < place, 1.0, 0.8)
    found, size = lasting_change(values + np.random.default_rng(1).normal(0, spread, 100))
    assert abs(found - place) <= (1 if spread else 0)
    assert size == pytest.approx(-0.2, abs=0.01)


def test_residuals_that_jump_and_a_prediction_that_falls_are_named():
    table = steady(200)
    table["view_residual"][120:, 2] *= 3
    table["view_residual"][[40, 41], 0] *= 5
    table["psnr"][120:, 2] -= 6
    found = {one.kind: one for one in watch(table, range(200), CAMERAS)}
    assert found["residual"].camera == found["psnr"].camera == "cam02"
    assert abs(found["residual"].frame - 120) <= 2
    assert found["psnr"].size == pytest.approx(-6, abs=1)
    assert (found["spikes"].camera, found["spikes"].size) == ("cam00", 2)
    assert "2 frames" in found["spikes"].line
    assert "40, 41" in found["spikes"].line


def test_frames_left_out_are_listed_and_many_cameras_share_a_line():
    table = steady(100, correlation=0)
    table["complete"][[3, 7]] = 2
    for name in ("view_light", "view_residual", "psnr"):
        table[name][[3, 7]] = np.nan
    table["view_residual"][50:] *= [2, 3, 4]
    lines = in_words(watch(table, range(100), CAMERAS))
    assert len(lines) == 2
    assert lines[0].startswith("2 frames could not be read and left out: 3, 7")
    assert lines[1].startswith("cam02: residual jumps to 4.0 times from frame 5")
    assert "less so cam01" in lines[1]


def test_dark_frames_count_for_nothing():
    table = steady(100)
    for name in ("view_light", "view_residual"):
        table[name][::2] = np.nan
    table["view_residual"][1::4] = 0
    assert watch(table, range(100), CAMERAS) == []


def test_gains_are_those_against_the_other_cameras():
    """All become brighter where the volume follows one that does."""
    table = steady(200, correlation=0)
    table["view_light"][100:] *= [1.1, 1.0, 1.0]
    table["view_light"][100:] /= 1.05
    (one,) = watch(table, range(200), CAMERAS)
    assert one.camera == "cam00"
    assert one.size == pytest.approx(0.1, abs=0.01)
