"""The answer: explained or not, from each view's residual and its own noise."""

from types import SimpleNamespace

import numpy as np
import pytest

from tomo.pipeline.answer import (
    EXPLAINED,
    NOT_EXPLAINED,
    PARTLY,
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


def outcome(*views):
    return SimpleNamespace(views=views, preview=None)


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
    assert "23%" in found.sentence
    assert found.missed == pytest.approx(view.beyond_noise / 2, rel=0.01)


def test_the_worst_view_of_unexplained_images_is_reported_but_not_accused():
    """Whatever is wrong with a volume, some view is missed most."""
    views = [View(f"cam0{n}", flame(), flame(column=32 + n)) for n in range(4)]
    found = answer_of(outcome(*views))
    assert found.verdict == NOT_EXPLAINED
    assert found.report()["worst_camera"] == "cam03"
    assert "cam0" not in found.sentence


def test_details_finer_than_a_voxel_do_not_count():
    fine = 0.1 * flame() * np.where((ROWS + COLUMNS) % 2, 1, -1).astype(np.float32)
    view = View("cam", flame() + fine, flame())
    assert view.relative_residual > 0.09
    assert view.beyond_noise < 0.001
    assert verdict_of(view) == EXPLAINED


def test_a_residual_of_many_times_the_noise_is_not_explained_up_to_it():
    """However little of an image it is: 0.5 % of it at a noise of 0.1 %."""
    view = View("cam", flame() + noise(0.0003), 1.005 * flame())
    assert view.residual_over_noise > 3
    assert view.beyond_noise == pytest.approx(0.005, rel=0.1)
    assert verdict_of(view) == PARTLY
    sentence = answer_of(outcome(view)).sentence
    assert "0.5% of an image" in sentence
    assert f"noise is {view.relative_noise:.1%}" in sentence


def test_pixels_that_cannot_see_the_grid_do_not_count():
    image = flame() + flame(row=60)
    seen = np.broadcast_to(ROWS < 45, image.shape)
    assert View("cam", image, flame()).beyond_noise > 0.4
    assert View("cam", image, flame(), in_sight=seen).beyond_noise < 0.1
    assert View("cam", image, flame(), in_sight=seen).psnr(1.0) == View(
        "cam", image, flame()
    ).psnr(1.0)


@pytest.mark.parametrize(("gain", "level"), [(1.0, 0.05), (0.8, 0.0), (1.2, -0.02)])
def test_gain_and_background_of_a_held_out_view_are_fitted_beside_its_figures(gain, level):
    view = View("cam", gain * flame() + level + noise(0.002), flame(), held_out=True)
    figures = view.held_out_figures(1.0)
    fitted = figures["fitted"]
    assert fitted["gain"] == pytest.approx(gain, abs=0.005)
    assert fitted["background"] == pytest.approx(level, abs=0.001)
    assert fitted["psnr"] > figures["psnr"] + 10
    assert fitted["beyond_noise"] == 0 < view.beyond_noise
    assert figures["psnr"] == view.psnr(1.0)


def test_each_view_counts_by_its_own_noise():
    views = [
        View("noisy", flame() + noise(0.1), flame()),
        View("clean", flame(), flame(column=32.6)),
    ]
    assert views[0].relative_residual > 5 * views[1].relative_residual
    assert verdict_of(views[0]) == EXPLAINED
    assert verdict_of(views[1]) == PARTLY
    assert worst_view(views) is views[1]
    assert answer_of(outcome(*views)).report()["worst_camera"] == "clean"


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
