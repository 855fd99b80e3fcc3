"""A volume's light in pictures: line integrals at the right places, on a readable scale."""

import io

import numpy as np
import pytest
from PIL import Image

from tomo.draw.emission import (
    Looks,
    brightest_integral,
    emission_image,
    end_of_scale,
    eye_of,
    turning_gif,
)
from tomo.draw.frame import Up
from tomo.draw.scene import ColourScale
from tomo.grid import Volume, VoxelGrid

GRID = VoxelGrid((12, 20, 16), (0.5, 1.0, 0.75), (10.0, 20.0, 30.0))
UPS = [Up(), Up(2), Up(0, -1)]


@pytest.mark.parametrize("up", UPS)
def test_the_middle_of_a_uniform_volume_is_its_chord(up):
    viewpoint = eye_of(GRID, (61, 61), 70.0, up)
    pixel = np.round(viewpoint.project(GRID.center)[0]).astype(int)
    plane = (pixel - viewpoint.principal) / viewpoint.focal
    direction = np.append(plane, 1) @ viewpoint.axes / np.linalg.norm([*plane, 1])
    both = np.stack([GRID.lower - viewpoint.eye, GRID.upper - viewpoint.eye]) / direction
    chord = both.max(axis=0).min() - both.min(axis=0).max()
    image = emission_image(Volume(np.full(GRID.shape, 3.0), GRID), viewpoint)
    assert image[pixel[1], pixel[0]] == pytest.approx(3 * chord, rel=1e-3)


@pytest.mark.parametrize("up", UPS)
def test_a_bright_voxel_is_where_its_centre_is_seen(up):
    viewpoint = eye_of(GRID, (150, 200), 40.0, up)
    for voxel in ((1, 17, 3), (10, 2, 14)):
        data = np.zeros(GRID.shape, np.float32)
        data[voxel] = 1.0
        image = emission_image(Volume(data, GRID), viewpoint)
        v, u = np.mgrid[: image.shape[0], : image.shape[1]]
        middle = [(image * u).sum() / image.sum(), (image * v).sum() / image.sum()]
        expected = viewpoint.project(GRID.centers()[voxel])[0]
        np.testing.assert_allclose(middle, expected, atol=0.5)


def test_from_afar_the_light_of_all_pixels_is_the_total_emission():
    around = (GRID.centers() - GRID.center) / GRID.extent
    data = np.exp(-((around * 6) ** 2).sum(axis=-1)).astype(np.float32)
    viewpoint = eye_of(GRID, (200, 200))
    light = emission_image(Volume(data, GRID), viewpoint).sum()
    assert light * viewpoint.pixel_at(GRID.center) ** 2 == pytest.approx(
        data.sum() * np.prod(GRID.spacing), rel=0.02
    )


@pytest.mark.parametrize(
    ("shape", "up"), [*zip([(40, 1, 40), (1, 44, 36), (30, 140, 30)], UPS, strict=True)]
)
def test_colours_end_little_above_what_is_seen_of_flat_volumes_too(shape, up):
    grid = VoxelGrid(shape, 1.0)
    data = np.exp(-(grid.centers() ** 2).sum(axis=-1) / 80).astype(np.float32)
    full = brightest_integral(Volume(data, grid), up)
    seen = [
        emission_image(Volume(data, grid), eye_of(grid, (200, 200), azimuth, up)).max()
        for azimuth in (28.0, 73.0, 118.0, 163.0)
    ]
    assert 0.7 * full < max(seen) < 1.05 * full


@pytest.mark.parametrize("most", [1e-30, 0.99, 1.0, 7.1, 3e20])
def test_a_scale_ends_at_or_little_above_the_largest(most):
    assert most <= end_of_scale(most) * (1 + 1e-12)
    assert end_of_scale(most) <= 1.34 * most
    assert float(f"{end_of_scale(most):.3g}") == end_of_scale(most)


def test_an_animation_turns_once_in_the_colours_of_the_map():
    data = np.zeros(GRID.shape, np.float32)
    data[9:, 8:12, 12:] = 1.0
    made = turning_gif(Volume(data, GRID), colours="viridis", height=60, frames=8)
    film = Image.open(io.BytesIO(made))
    assert film.n_frames == 8
    assert film.info["loop"] == 0
    pictures = []
    for number in range(film.n_frames):
        film.seek(number)
        pictures.append(np.asarray(film.convert("RGB")))
    assert len({picture.tobytes() for picture in pictures}) == 8
    assert pictures[0].shape[0] == 60
    colours = ColourScale("", 0, 1, "viridis")(np.linspace(0, 1, 256))
    seen = np.unique(np.concatenate([one.reshape(-1, 3) for one in pictures]), axis=0)
    distances = np.abs(seen[:, None] / 255 - colours).max(axis=2).min(axis=1)
    assert distances.max() < 0.01


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"levels": (1.5,)}, "level: found 1.5, expected up to three numbers between 0 and 1"),
        ({"levels": (0.1, 0.2, 0.3, 0.4)}, "level: found 0.1, 0.2, 0.3, 0.4, expected up to"),
        ({"colours": "none such"}, "colormap: found 'none such', expected one of matplotlib's"),
    ],
)
def test_looks_that_cannot_be_drawn_are_refused(options, words):
    with pytest.raises(ValueError, match=words):
        Looks(**options)
