"""The answer: explained or not, from each view's residual and its own noise."""

from types import SimpleNamespace

import numpy as np
import pytest

from tomo.inference.finding import Finding
from tomo.pipeline.answer import (
    EXPLAINED,
    NOT_EXPLAINED,
    PARTLY,
    UNKNOWN,
    UNKNOWN_VERDICT,
    answer_of,
    verdict_of,
    worst_view,
)
from tomo.pipeline.view import View

SIZE = 64
ROWS, COLUMNS = np.mgrid[:SIZE, :SIZE]


def flame(row=32.0, column=32.0, width=9.0):
    away = (ROWS - row) ** 2 + (COLUMNS - column) ** 2
    return np.exp(-away / (2 * width**2)).astype(np.float32)


def noise(sigma, seed=0):
    draws = np.random.default_rng(seed).standard_normal((SIZE, SIZE))
    return (sigma * draws).astype(np.float32)


def outcome(*views, findings=()):
    return SimpleNamespace(views=views, findings=findings)


@pytest.mark.parametrize("sigma", [0.002, 0.02, 0.1])
def test_a_view_that_differs_by_its_noise_is_explained(sigma):
    view = View("cam", flame() + noise(sigma), flame())
    size = np.sqrt(np.mean(view.measured.astype(float) ** 2))
    assert view.relative_noise == pytest.approx(sigma / size, rel=0.15)
    assert view.residual_over_noise == pytest.approx(1, rel=0.15)
    assert verdict_of(view) == EXPLAINED


def test_one_percent_of_noise_does_not_explain_a_quarter_of_the_image():
    view = View("cam03", flame() + noise(0.003), flame(column=35))
    assert view.relative_noise < 0.015
    assert view.relative_residual > 0.2
    assert verdict_of(view) == NOT_EXPLAINED
    others = [View(f"cam0{n}", flame() + noise(0.003, n), flame()) for n in range(3)]
    found = answer_of(outcome(*others, view))
    assert found.sentence.startswith("Not explained: up to 23% of an image stays unexplained")
    assert found.missed == pytest.approx(view.beyond_noise / 2, rel=0.01)


def test_the_worst_view_of_unexplained_images_is_reported_but_not_accused():
    """Whatever is wrong with a volume, some view is missed most."""
    views = [View(f"cam0{n}", flame(), flame(column=32 + n)) for n in range(4)]
    found = answer_of(outcome(*views))
    assert found.verdict == NOT_EXPLAINED
    assert found.report()["worst_camera"] == "cam03"
    assert "cam0" not in found.sentence
    assert "no cause that was tested explains it" in found.sentence


@pytest.mark.parametrize("sigma", [0.003, 0.1])
def test_a_fault_shows_through_noise(sigma):
    """Means over pixels have less noise: three pixels off is seen at a tenth of the maximum."""
    view = View("cam", flame() + noise(sigma), flame(column=36))
    assert verdict_of(view) == NOT_EXPLAINED


def test_details_finer_than_a_voxel_do_not_count():
    fine = 0.1 * flame() * np.where((ROWS + COLUMNS) % 2, 1, -1).astype(np.float32)
    view = View("cam", flame() + fine, flame())
    assert view.relative_residual > 0.09
    assert view.beyond_noise < 0.001
    assert verdict_of(view) == EXPLAINED


def test_each_view_counts_by_its_own_noise():
    views = [
        View("noisy", flame() + noise(0.1), flame()),
        View("clean", flame(), flame(column=32.6)),
    ]
    assert views[0].relative_residual > 5 * views[1].relative_residual
    assert verdict_of(views[0]) == EXPLAINED
    assert verdict_of(views[1]) == PARTLY
    assert worst_view(views) is views[1]
    sentence = answer_of(outcome(*views)).sentence
    assert sentence.startswith("Explained in part")
    assert UNKNOWN in sentence


def test_views_that_took_no_part_do_not_decide():
    wrong = flame(column=45)
    views = [
        View("cam00", flame() + noise(0.01), flame()),
        View("cam01", flame() + noise(0.01), wrong, held_out=True),
        View("cam02", flame() + noise(0.01), wrong, excluded=True),
    ]
    found = answer_of(outcome(*views))
    assert found.verdict == EXPLAINED
    assert "without camera cam02" in found.sentence
    assert "cam01" not in found.sentence


def test_dark_images_have_no_answer():
    dark = np.zeros((SIZE, SIZE), np.float32)
    for found in (answer_of(outcome(View("cam", dark, dark))), answer_of(outcome())):
        assert found.verdict == UNKNOWN_VERDICT
        assert found.sentence.startswith("Not known")
        assert found.report()["worst_camera"] is None


@pytest.mark.parametrize(
    ("finding", "words"),
    [
        (Finding("outside", size=0.3, unit="%"), "30.0 % of the light comes from outside"),
        (Finding("pose", "cam01", 1.28, unit="px"), "camera cam01: its pose is off"),
        (Finding("absorption", size=0.5), "optical depth 0.5"),
        (Finding("order", "cam00", other="cam01"), "its image is that of camera cam01"),
        (Finding("background", "cam01", 0.02, unit="%", corrected=False), "not corrected"),
    ],
)
def test_the_causes_are_what_was_found(finding, words):
    view = View("cam00", flame(), flame(column=38))
    sentence = answer_of(outcome(view, findings=(finding,))).sentence
    assert words in sentence
    assert UNKNOWN not in sentence


def test_an_explained_volume_needs_no_causes():
    view = View("cam00", flame() + noise(0.01), flame())
    found = answer_of(outcome(view, findings=(Finding("gain", "cam00", 0.08, unit="%"),)))
    assert found.causes == ()
    assert "gain" not in found.sentence
