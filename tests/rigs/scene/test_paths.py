"""Paths through scenes against closed forms and conserved quantities."""

import dataclasses
import math

import numpy as np
import pytest
import trimesh
from hypothesis import given
from hypothesis import strategies as st

from rigs.scene import Cylinder, Glass, Mesh, Mirror, Opaque, Reflecting, Scene, Sphere, Window
from rigs.scene.paths import MOST_FACES
from rigs.scene.tracing import CONTRADICTORY, OPAQUE, OPEN, REFLECTED, TRAPPED

from . import closed_forms as forms
from .twin import slow_path

QUARTZ = 1.4585


def unit(vectors):
    vectors = np.asarray(vectors, float)
    return vectors / np.linalg.norm(vectors, axis=-1, keepdims=True)


def rays(count=200, seed=0, far=100.0, wide=20.0):
    """Rays from afar through the neighbourhood of the origin."""
    rng = np.random.default_rng(seed)
    origins = far * unit(rng.normal(size=(count, 3)))
    return origins, unit(rng.uniform(-wide, wide, (count, 3)) - origins)


def last_pieces(paths):
    last = paths.ray_ptr[1:] - 1
    return paths.origins[last], paths.directions[last]


def mesh_of(shape, material, name="mesh"):
    return Mesh(name, shape.vertices, shape.faces, material)


def line_distance(points, origins, directions):
    away = points - origins
    return np.linalg.norm(away - (away * directions).sum(1)[:, None] * directions, axis=1)


@pytest.mark.parametrize("degrees", [0, 10, 30, 60])
def test_a_plate_shifts_rays_as_the_formula_says(degrees):
    angle = math.radians(degrees)
    normal = np.array([math.sin(angle), 0, math.cos(angle)])
    window = Window("w", (0, 0, 50), normal, 10, Glass(QUARTZ))
    origins, directions = (
        np.tile([1.0, 2, 200], (50, 1)),
        unit(np.random.default_rng(1).normal(0, 0.1, (50, 3)) - [0, 0, 1]),
    )
    found, ahead = last_pieces(Scene((window,)).paths(origins, directions))
    np.testing.assert_allclose(ahead, directions, atol=1e-14)
    wanted = forms.behind_plate(origins, directions, normal, 10, QUARTZ)
    assert line_distance(wanted, found, ahead).max() < 1e-10


def test_a_prism_turns_rays_by_its_deviation_and_a_mesh_of_planes_is_exact():
    apex, incidence = math.radians(50), math.radians(35)
    foot = math.tan(apex / 2) * 40
    section = np.array([[0, 0], [-foot, -40], [foot, -40]])
    corners = [[*corner, z] for corner in section for z in (-30, 30)]
    scene = Scene((mesh_of(trimesh.convex.convex_hull(corners), Glass(1.6)),))
    # the first face looks to the upper left; its normal into the glass is 25 degrees below x
    heading = incidence - apex / 2
    direction = np.array([math.cos(heading), math.sin(heading), 0.0])
    start = np.array([-math.tan(apex / 2) * 15, -15, 0.3]) - 50 * direction
    paths = scene.paths([start], [direction])
    assert paths.ends.tolist() == [OPEN]
    assert len(paths.lengths) == 3
    _, (out,) = last_pieces(paths)
    deviation = math.acos(min(1, float(out @ direction)))
    assert deviation == pytest.approx(float(forms.prism_deviation(apex, incidence, 1.6)), abs=1e-9)


def test_a_ball_focuses_as_the_closed_form_says():
    height = np.array([0.01, 0.5, 2.0, 4.0])
    scene = Scene((Sphere("ball", (0, 0, 0), 5, Glass(1.5)),))
    origins = np.stack([height, 0 * height, 0 * height + 80], axis=1)
    point, ahead = last_pieces(scene.paths(origins, np.tile([0.0, 0, -1], (4, 1))))
    crossing = point[:, 2] - point[:, 0] / ahead[:, 0] * ahead[:, 2]
    np.testing.assert_allclose(-crossing, forms.ball_crossing(height, 10, 1.5), rtol=1e-10)
    assert -crossing[0] == pytest.approx(forms.ball_focus(10, 1.5), rel=1e-5)


@pytest.mark.parametrize("inside", [1.0, 1.333])
def test_a_tube_bends_rays_as_the_closed_form_says(inside):
    tube = Cylinder(
        "t", (0, 0, 0), (0, 0, 1), 20, math.inf, Glass(QUARTZ), inner_radius=17, inside=inside
    )
    for aside in (-16.0, -9.0, 0.5, 9.0):
        origin, direction = np.array([-80.0, aside, 5]), unit([1.0, 0.05, 0.2])
        paths = Scene((tube,)).paths([origin], [direction])
        points, directions = forms.tube_path(origin, direction, [20, 17], [1.0, QUARTZ, inside])
        np.testing.assert_allclose(paths.origins[1:], points, atol=1e-10)
        np.testing.assert_allclose(paths.directions[1:], directions, atol=1e-12)


def test_a_mirror_is_a_virtual_camera():
    point, normal = np.array([60.0, 5, 0]), unit([-1.0, 0.2, 1])
    origins = np.tile([60.0, 0, 400], (40, 1))
    directions = unit(
        np.array([60.0, 5, 0]) + np.random.default_rng(0).uniform(-15, 15, (40, 3)) - origins
    )
    found, ahead = last_pieces(Scene((Mirror("m", point, normal),)).paths(origins, directions))
    virtual = forms.mirror_image(origins, point, normal)
    np.testing.assert_allclose(ahead, forms.mirrored_directions(directions, normal), atol=1e-14)
    assert line_distance(virtual, found, ahead).max() < 1e-9  # of 500 that rays are long


SOLIDS = (
    Window("window", (0, 0, 60), (0.2, 0.1, 1), 8, Glass("quartz"), size=50),
    Cylinder("tube", (0, 0, 0), (0.1, 1, 0), 25, 90, Glass(1.47), inner_radius=22),
    Sphere("ball", (3, 5, 2), 12, Glass(1.6)),
    Mirror("mirror", (0, 0, -50), (0, 0.1, 1), size=(60, 40)),
)


def test_the_compiled_tracer_follows_its_slow_twin():
    rim = Window("rim", (70, 0, 0), (1, 0, 0.1), 6, Glass(1.52, 0.01), size=(40, 60))
    full = Cylinder(
        "full", (0, -80, 0), (1, 0, 0), 15, 50, Glass(1.49), inner_radius=13, inside="water"
    )
    scene = Scene((*SOLIDS, rim, full, Sphere("stop", (0, 70, 0), 8, Opaque())))
    faces = np.concatenate([solid.faces(1.0) for solid in scene.solids])
    origins, directions = rays(300, seed=11, far=200, wide=50)
    paths = scene.paths(origins, directions)
    met = 0
    for ray in range(len(paths)):
        pieces, end = slow_path(faces, 1.0, origins[ray], directions[ray])
        assert end == paths.ends[ray]
        own = slice(paths.ray_ptr[ray], paths.ray_ptr[ray + 1])
        slow = [np.array(column) for column in zip(*pieces, strict=True)]
        for name, wanted in zip(("origins", "directions", "lengths", "weight"), slow, strict=True):
            np.testing.assert_allclose(getattr(paths, name)[own], wanted, atol=1e-9)
        met += len(pieces) > 1
    assert met > 100
    assert len(set(paths.ends.tolist())) == 3


def test_paths_traced_back_return():
    """A piece's end, sent back, meets the start, within 1e-9 of the path's length."""
    scene = Scene(SOLIDS)
    origins, directions = rays(2000)
    forward = scene.paths(origins, directions)
    open_ended = np.flatnonzero((forward.ends == OPEN) & (np.diff(forward.ray_ptr) > 1))
    assert len(open_ended) > 300
    point, ahead = last_pieces(forward)
    start = (point + 50 * ahead)[open_ended]
    back = scene.paths(start, -ahead[open_ended])
    lengths = np.add.reduceat(
        np.where(np.isfinite(forward.lengths), forward.lengths, 50), forward.ray_ptr[:-1]
    )[open_ended]
    home, homeward = last_pieces(back)
    assert (np.diff(back.ray_ptr) == np.diff(forward.ray_ptr)[open_ended]).all()
    missed = line_distance(origins[open_ended], home, homeward)
    assert (missed < 1e-9 * lengths).all()
    assert (
        line_distance(home, origins[open_ended], directions[open_ended]) < 1e-9 * lengths
    ).all()


def test_snells_law_and_the_optical_path_hold_at_every_face():
    """The part of ``n d`` along a face stays; pieces join end to start."""
    scene = Scene(SOLIDS)
    paths = scene.paths(*rays(2000, seed=3))
    joined = np.setdiff1d(np.arange(len(paths.lengths)), paths.ray_ptr[1:] - 1)
    end = paths.origins[joined] + paths.lengths[joined, None] * paths.directions[joined]
    np.testing.assert_allclose(paths.origins[joined + 1], end, atol=1e-11)
    assert np.abs(np.linalg.norm(paths.directions, axis=1) - 1).max() < 1e-14


@given(
    first=st.floats(1, 2), second=st.floats(1, 2), angle=st.floats(0, 1.5), turn=st.floats(0, 6.28)
)
def test_fresnel_takes_what_closed_forms_say_and_total_reflection_ends(first, second, angle, turn):
    """One face between two media: the first of a window whose second is never met from inside."""
    across = np.array([math.cos(turn), math.sin(turn), 0])
    direction = math.sin(angle) * across - np.array([0, 0, math.cos(angle)])
    window = Window("w", (0, 0, 0), (0, 0, 1), 1, Glass(second))
    paths = Scene((window,), medium=first, fresnel=True).paths([[0, 0, 5.0]], [direction])
    passed = float(forms.fresnel_transmission(angle, first, second))
    if first / second * math.sin(angle) >= 1:
        assert paths.ends.tolist() == [REFLECTED]
        assert len(paths.weight) == 1
    else:
        assert paths.weight[1] == pytest.approx(passed, rel=1e-6, abs=1e-7)
        assert paths.weight[2] == pytest.approx(passed**2, rel=1e-6, abs=1e-7)  # Stokes


def test_glass_that_absorbs_follows_beers_law():
    window = Window("w", (0, 0, 0), (0, 0, 1), 7, Glass(1.5, extinction=0.03))
    paths = Scene((window,)).paths([[0, 0, 5.0]], [unit([0.5, 0, -1])])
    inside = paths.lengths[1]
    np.testing.assert_allclose(paths.weight, [1, 1, math.exp(-0.03 * inside)], rtol=1e-14)


def test_facets_come_nearer_to_the_ball_at_their_order():
    """A facet's slope is off by its size, an interpolated normal by the size squared."""
    ball = Scene((Sphere("ball", (0, 0, 0), 5, Glass(1.5)),))
    origins = np.tile([0.0, 0, 60], (300, 1))
    origins[:, :2] = np.random.default_rng(0).uniform(-2.5, 2.5, (300, 2))
    directions = np.tile([0.0, 0, -1], (300, 1))
    _, exact = last_pieces(ball.paths(origins, directions))
    errors = {}
    for smooth in (False, True):
        for divided in (3, 4):
            shape = trimesh.creation.icosphere(subdivisions=divided, radius=5)
            mesh = dataclasses.replace(mesh_of(shape, Glass(1.5)), smooth=smooth)
            paths = Scene((mesh,)).paths(origins, directions)
            assert (paths.ends == OPEN).all()
            errors[smooth, divided] = np.median(
                np.linalg.norm(last_pieces(paths)[1] - exact, axis=1)
            )
    assert errors[False, 3] / errors[False, 4] == pytest.approx(2, rel=0.25)
    assert errors[True, 3] / errors[True, 4] == pytest.approx(4, rel=0.25)


def test_opaque_solids_end_rays_where_they_stand():
    rod = Cylinder("rod", (0, 0, 0), (0, 1, 0), 2, 60, Opaque())
    shape = trimesh.creation.cylinder(2, 60, sections=720)
    shape.apply_transform(trimesh.transformations.rotation_matrix(-np.pi / 2, [1, 0, 0]))
    origins, directions = rays(3000, wide=6)
    exact = Scene((rod,)).paths(origins, directions)
    facets = Scene((mesh_of(shape, Opaque()),)).paths(origins, directions)
    assert (exact.ends == OPAQUE).mean() > 0.1
    same = exact.ends == facets.ends
    assert same.mean() > 0.998  # but for rays that graze
    both = np.flatnonzero(same & (exact.ends == OPAQUE))
    np.testing.assert_allclose(exact.lengths[both], facets.lengths[both], atol=0.02)


def test_mirrors_that_face_each_other_are_left_after_a_bounded_number_of_reflections():
    pair = (Mirror("a", (0, 0, -10), (0, 0, 1)), Mirror("b", (0, 0, 10), (0, 0, -1)))
    paths = Scene(pair).paths([[0, 0, 0.0]], [unit([1e-9, 0, 1])])
    assert paths.ends.tolist() == [TRAPPED]
    assert len(paths.lengths) == MOST_FACES + 1


def test_a_reflecting_ball_takes_its_share_and_shows_the_law_of_reflection():
    scene = Scene((Sphere("ball", (0, 0, 0), 5, Reflecting(0.9)),))
    origins, directions = rays(400, wide=4)
    paths = scene.paths(origins, directions)
    hit = np.flatnonzero(np.diff(paths.ray_ptr) == 2)
    assert len(hit) > 200
    second = paths.ray_ptr[hit] + 1
    normal = paths.origins[second] / 5
    into, out = directions[hit], paths.directions[second]
    np.testing.assert_allclose((into * normal).sum(1), -(out * normal).sum(1), atol=1e-12)
    assert np.abs(np.cross(into, normal) - np.cross(out, normal)).max() < 1e-12
    assert (paths.weight[second] == 0.9).all()


def test_a_ray_whose_media_contradict_each_other_is_not_followed():
    """Water begins behind one window and ends behind none: the ball's face expects air."""
    window = Window("w", (0, 0, 50), (0, 0, 1), 5, Glass(1.5), beyond="water")
    scene = Scene((window, Sphere("ball", (0, 0, 0), 5, Glass(1.6))))
    paths = scene.paths([[0, 0, 100.0], [30, 0, 100]], [[0, 0, -1.0]] * 2)
    assert paths.ends.tolist() == [CONTRADICTORY, OPEN]


def test_far_cameras_lose_no_digits():
    """A ball of 1 at 1e6: the piece inside is a chord of the ball to 1e-9."""
    origins = np.array([[0.3, 0.4, 1e6]])
    paths = Scene((Sphere("ball", (0, 0, 0), 1, Glass(1.0)),)).paths(origins, [[0, 0, -1.0]])
    assert paths.lengths[1] == pytest.approx(2 * math.sqrt(0.75), abs=1e-9)


def test_rays_of_a_block_do_not_depend_on_the_others():
    scene = Scene((*SOLIDS, mesh_of(trimesh.creation.icosphere(2, 4), Opaque()).transformed(
        np.eye(3), np.array([0, 0, 85.0]))))  # fmt: skip
    origins, directions = rays(9000, seed=5)
    every = scene.paths(origins, directions)
    for ray in (0, 17, 8191, 8192, 8999):
        alone = scene.paths(origins[ray : ray + 1], directions[ray : ray + 1])
        own = slice(every.ray_ptr[ray], every.ray_ptr[ray + 1])
        for name in ("origins", "directions", "lengths", "weight", "solids"):
            assert np.array_equal(getattr(alone, name), getattr(every, name)[own])
