import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import quad
from scipy.spatial.transform import Rotation

from phantoms import GaussianBlobs

coordinate = st.floats(-3, 3)
vector = st.tuples(coordinate, coordinate, coordinate)
blobs = st.lists(
    st.tuples(vector, st.floats(0.2, 2), st.floats(0, 3)), min_size=1, max_size=4
).map(lambda parts: GaussianBlobs(*zip(*parts, strict=True)))
rotation = st.tuples(vector, st.floats(0, 6)).map(
    lambda v: Rotation.from_rotvec(np.array(v[0]) * v[1] / 3)
)


def unit(direction):
    return np.asarray(direction) / np.linalg.norm(direction)


directions = vector.filter(lambda v: np.linalg.norm(v) > 0.1).map(unit)


@given(field=blobs, origin=vector, direction=directions, length=st.floats(0, 12))
@settings(max_examples=20)
def test_line_integral_is_the_integral_of_the_field(field, origin, direction, length):
    nearest = np.clip((np.array(field.centers) - origin) @ direction, 0, length)
    expected, _ = quad(
        lambda s: float(field(origin + s * direction)),
        0,
        length,
        points=np.unique(nearest),
        epsabs=1e-10,
        limit=200,
    )
    assert field.line_integral(origin, direction, length) == pytest.approx(expected, abs=1e-8)


@given(field=blobs, origin=vector, direction=directions, motion=rotation, shift=vector)
def test_moving_blobs_and_lines_together_changes_nothing(field, origin, direction, motion, shift):
    def move(points):
        return motion.apply(points) + shift

    moved = GaussianBlobs(move(field.centers), field.widths, field.amplitudes)
    assert moved(move(origin)) == pytest.approx(float(field(origin)), abs=1e-10)
    assert moved.line_integral(move(origin), motion.apply(direction), 5.0) == pytest.approx(
        float(field.line_integral(origin, direction, 5.0)), abs=1e-10
    )


def test_line_through_a_middle_from_far_away():
    """The whole line through one blob is a s √(2π), from a camera 1e7 away as well."""
    field = GaussianBlobs([[1, 2, 3]], [0.5], [2.0])
    direction = unit([1, -2, 0.5])
    for distance in (50.0, 5800.0, 1e7):
        found = field.line_integral(np.array([1, 2, 3]) - distance * direction, direction)
        assert found == pytest.approx(2.0 * 0.5 * np.sqrt(2 * np.pi), rel=1e-12)


def test_directions_are_normalised_and_shapes_broadcast():
    field = GaussianBlobs.random(1)
    origins = np.random.default_rng(0).normal(size=(4, 1, 3))
    lines = np.random.default_rng(1).normal(size=(5, 3))
    found = field.line_integral(origins, lines, np.full((4, 5), 3.0))
    assert found.shape == (4, 5)
    np.testing.assert_allclose(found, field.line_integral(origins, 7 * lines, 3.0), rtol=1e-12)


def test_pieces_of_a_line_add_up():
    field, direction = GaussianBlobs.random(2), unit([0.2, 1, 0.1])
    start = np.array([-1.0, -40.0, 0.5])
    pieces = [
        field.line_integral(start + s * direction, direction, 10.0) for s in range(0, 80, 10)
    ]
    assert sum(pieces) == pytest.approx(float(field.line_integral(start, direction, 80.0)))


@pytest.mark.parametrize("extent", [(15, 70, 15), (1, 1, 1), (100, 20, 300)])
def test_random_blobs_stay_round_and_inside(extent):
    field = GaussianBlobs.random(3, extent)
    centers, widths = np.array(field.centers), np.array(field.widths)
    assert (np.abs(centers) + 5.999 * widths[:, None] <= np.array(extent) / 2).all()


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (([[0, 0]], [1], [1]), "centers"),
        (([[0, 0, np.inf]], [1], [1]), "centers"),
        (([[0, 0, 0]], [0], [1]), "widths"),
        (([[0, 0, 0]], [1, 2], [1]), "widths"),
        (([[0, 0, 0]], [1], [-1]), "amplitudes"),
    ],
)
def test_bad_blobs(arguments, words):
    with pytest.raises(ValueError, match=words):
        GaussianBlobs(*arguments)


def test_bad_lines():
    field = GaussianBlobs.random()
    with pytest.raises(ValueError, match="zero vector"):
        field.line_integral([0, 0, 0], [0, 0, 0])
    with pytest.raises(ValueError, match="lengths"):
        field.line_integral([0, 0, 0], [0, 0, 1], -1)
