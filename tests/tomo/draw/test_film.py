import base64
import json

import numpy as np
import pytest

from tomo.draw import Scene
from tomo.draw.chart import HIGH, WIDE, chart, polylines
from tomo.draw.film import film_of
from tomo.draw.stage import fitting, stage
from tomo.draw.volume.isosurface import reference_value
from tomo.grid import Volume, VoxelGrid

GRID = VoxelGrid((6, 9, 4), (1.0, 0.5, 2.0), (0.0, 3.0, 0.0))


def volume_of(time):
    volume = np.zeros(GRID.shape, np.float32)
    volume[time % 6, 7, 1] = 2.0 + time
    return Volume(volume, GRID, value_unit="W/m^3")


@pytest.fixture(scope="module")
def film():
    """Return the data that a page has of a film of six frames."""
    moments = [(f"frame {time}", time / 5, volume_of(time)) for time in range(6)]
    shown = film_of(moments, 6)
    return json.loads(stage(Scene(), shown=shown)["data"])


def numbers(text):
    return np.frombuffer(base64.b64decode(text), np.uint8)


def test_every_frame_has_its_own_volume_on_one_scale(film):
    volume = film["volume"]
    assert volume["shape"] == list(GRID.shape)
    highest = volume["highest"]
    assert highest == reference_value(volume_of(5))
    for time, frame in enumerate(volume["frames"]):
        expected = np.clip(np.round(volume_of(time) * (255 / highest)), 0, 255)
        assert np.array_equal(numbers(frame).reshape(GRID.shape), expected)
    assert [one["at"] for one in film["moments"]] == [0, 0.2, 0.4, 0.6, 0.8, 1]
    assert [one["label"] for one in film["moments"]] == [f"frame {time}" for time in range(6)]


def test_voxels_that_nobody_sees_are_dark():
    volume = Volume(np.full(GRID.shape, np.nan, np.float32), GRID)
    data = json.loads(stage(Scene(), shown=film_of([("a", 0.0, volume)], 1))["data"])
    assert (numbers(data["volume"]["frames"][0]) == 0).all()


@pytest.mark.parametrize("shape", [(30, 30, 30), (1, 200, 200), (3, 5, 5000)])
def test_a_film_of_large_volumes_fits_into_a_page(monkeypatch, shape):
    """However flat they are."""
    monkeypatch.setattr("tomo.draw.stage.MOST_VOXELS", 8000)
    coarse = fitting(Volume(np.ones(shape, np.float32), VoxelGrid(shape, 1.0)), 10).grid
    assert 10 * coarse.size <= 8000
    assert 4 * 10 * coarse.size >= 8000 / 8  # and no coarser than that


def test_curves_have_few_points_and_lose_no_extreme():
    heights = np.full(100_000, 0.5)
    heights[77_777] = 1.0
    (line,) = polylines(heights)
    points = np.array([one.split(",") for one in line.split()], float)
    assert len(points) <= 2 * WIDE
    assert points[:, 1].min() == 0
    assert points[points[:, 1].argmin(), 0] == pytest.approx(0.77777 * WIDE, abs=0.1)
    assert points[:, 1].max() == HIGH / 2


def test_gaps_part_curves():
    lines = polylines(np.array([0.0, 1.0, np.nan, 0.5, np.nan]))
    assert len(lines) == 2
    assert len(lines[1].split()) == 2  # one point, twice


def test_charts_say_their_ends_and_the_figures_of_shown_frames():
    made = chart(
        "a", {"one": np.array([1.0, 2.0, np.nan]), "none": np.full(3, np.nan)}, shown=(1, 2)
    )
    assert (made.low, made.high) == ("1", "2")
    assert [one.name for one in made.curves] == ["one"]
    assert made.curves[0].values == ("2", "none")
    assert chart("a", {"none": np.full(3, np.nan)}) is None
