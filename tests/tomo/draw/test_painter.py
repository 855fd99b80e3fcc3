import numpy as np

from tomo.draw import Mesh, Scene, Viewpoint
from tomo.draw.painter import painted

SQUARE = np.array([[-1.0, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]])
HALVES = np.array([[0, 1, 2], [0, 2, 3]])
VIEWPOINT = Viewpoint.framing(SQUARE, (0, 0, 1), (0, 1, 0), (40, 40))


def square(z, colour):
    return Mesh("a", "b", np.add(SQUARE, [0, 0, z]), HALVES, colour)


def test_the_nearer_of_two_squares_is_seen_whichever_comes_first():
    far, near = square(-1, (1, 0, 0)), square(0, (0, 1, 0.5))
    for meshes in ((far, near), (near, far)):
        picture = painted(Scene(meshes), VIEWPOINT)
        np.testing.assert_allclose(picture[20, 20], [0, 1, 0.5])
        np.testing.assert_allclose(picture[0, 0], 0)
        assert 0.6 < (picture[..., 1] > 0.5).mean() < 0.8  # margins of 8 % on each side


def test_nothing_and_what_lies_behind_the_eye_is_black():
    behind = square(2 * VIEWPOINT.eye[2], (1, 1, 1))
    assert not painted(Scene(), VIEWPOINT).any()
    assert not painted(Scene((behind,)), VIEWPOINT).any()
