import av
import numpy as np
import pytest

from tomo.draw.film import FilmPicture
from tomo.export import export_series
from tomo.grid import Volume, VoxelGrid


def test_a_film_has_a_picture_a_frame_in_which_the_spot_moves(store, tmp_path):
    written = export_series(store, tmp_path / "flame.mp4", "mp4", (0, 10, 19))
    with av.open(str(written)) as film:
        pictures = [one.to_ndarray(format="gray").astype(float) for one in film.decode(video=0)]
    assert len(pictures) == 3
    first, last = pictures[0], pictures[-1]
    height, width = first.shape
    assert height == 720
    assert width % 2 == 0
    assert np.abs(first - last).max() > 100
    # the spot runs along x, which is to the right of this eye; labels stand in the first rows
    by = (last - first)[80:]
    across = [np.clip(by, 0, None).sum(0), np.clip(-by, 0, None).sum(0)]
    centres = [np.average(np.arange(width), weights=one) for one in across]
    assert centres[0] > centres[1] + 20


def test_pixels_show_the_light_along_the_line_at_its_place():
    grid = VoxelGrid((8, 10, 6), 1.0)
    picture = FilmPicture(Volume(np.zeros(grid.shape), grid), 6.0)
    empty = picture.draw(picture.example, "").astype(int)
    centres = []
    for x, y in ((1, 8), (6, 1)):
        volume = np.zeros(grid.shape, np.float32)
        volume[x, y, :] = 3.0
        drawn = picture.draw(Volume(volume, grid), "") - empty
        places = np.argwhere(drawn.sum(-1) > 100)
        assert len(places)
        centres.append(places.mean(axis=0))
    (upper, left), (lower, right) = centres
    assert upper < 360 < lower  # y runs upward
    assert left < right - 50  # x runs to the right


@pytest.mark.parametrize("shape", [(3, 200, 3), (200, 3, 3), (3, 3, 200), (1, 1, 1)])
def test_long_grids_are_drawn_within_bounds(shape):
    volume = Volume(np.ones(shape, np.float32), VoxelGrid(shape, 1.0))
    drawn = FilmPicture(volume, 1.0, title="t").draw(volume, "frame 1")
    assert drawn.shape[0] == 720
    assert 600 < drawn.shape[1] <= 1940
