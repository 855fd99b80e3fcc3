import numpy as np
import pytest

from tomo.draw import Mesh, Scene, Viewpoint, shapes
from tomo.draw.raster import render


def square(z, colour, opacity=1.0, half=1.0):
    corners = [[-half, -half, z], [half, -half, z], [half, half, z], [-half, half, z]]
    return Mesh("square", "squares", *shapes.fan([0, 0, z], corners), colour, opacity)


def front(scene, size=(60, 40)):
    return Viewpoint.framing(scene.bounds, (0, 0, 1), (0, 1, 0), size, distance=50)


def test_framing_fills_the_picture_inside_the_margins():
    points = np.random.default_rng(2).normal(size=(50, 3)) * [1, 9, 2] + [100, 0, -30]
    view = Viewpoint.framing(points, (1, 1, 2), (0, 1, 0), (400, 300), margins=(0.1,) * 4)
    uv = view.project(points)
    shares = np.ptp(uv, axis=0) / [320, 240]
    assert shares.max() == pytest.approx(1)
    assert (uv.min(axis=0) >= np.array([40, 30]) - 1).all()
    # right-handed with y up: a point higher in the world is higher in the picture
    assert np.corrcoef(points[:, 1], uv[:, 1])[0, 1] < -0.9


def test_picture_shows_the_mesh_where_it_projects_and_white_elsewhere():
    scene = Scene((square(0, (1.0, 0.0, 0.0)),))
    view = front(scene)
    picture = render(scene, view)
    assert picture.shape == (40, 60, 3)
    corners = view.project(scene.meshes[0].vertices[1:])
    area = np.ptp(corners[:, 0]) * np.ptp(corners[:, 1])
    covered = (1 - picture[..., 1]).sum()  # green is missing where the red square is
    assert covered == pytest.approx(area, rel=0.03)  # edges count in thirds of a pixel
    assert (picture[0, 0] == 1).all()
    assert picture[20, 30, 0] > 0.4 > picture[20, 30, 1]


def test_nearer_hides_farther_and_translucent_lets_it_through():
    red, blue = (1.0, 0.0, 0.0), (0.0, 0.0, 1.0)
    opaque = Scene((square(0, blue), square(0.1, red)))
    glass = Scene((square(0, blue), square(0.1, red, opacity=0.25)))
    view = front(opaque)
    assert render(opaque, view)[20, 30, 2] == 0
    light = render(opaque, view)[20, 30, 0]
    seen = render(glass, view)[20, 30]
    np.testing.assert_allclose(seen, [0.25 * light, 0, 0.75 * light], atol=1e-3)
