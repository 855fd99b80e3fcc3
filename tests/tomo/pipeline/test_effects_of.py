"""Which effects are looked for."""

import pytest

from tomo import VoxelGrid
from tomo.operators import TRANSPARENT
from tomo.pipeline import Options
from tomo.pipeline.infer import effects_of

GRID = VoxelGrid((12, 16, 12), 1.0)


def names(views, **options):
    return [one.name for one in effects_of(Options(**options), TRANSPARENT, GRID, 1, views)]


def test_the_default_looks_for_cameras_images_and_gas():
    expected = ["gain", "background", "fall-off", "blur", "medium", "absorber", "self-absorption"]
    assert names(12) == [*expected, "pose"]


@pytest.mark.parametrize("views", [3, 8])
def test_few_views_have_no_field_of_gas(views):
    assert "absorber" not in names(views)
    assert "medium" in names(views)


def test_what_is_refused_is_not_looked_for():
    assert names(12, screen=False, refine_cameras="none", fit_absorption=False) == []
    assert names(12, refine_cameras="none", fit_gain=False, fit_absorption=False) == [
        "fall-off",
        "blur",
    ]
    assert "medium" not in names(12, absorption=0.01)
