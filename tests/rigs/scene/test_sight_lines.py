"""Directions in which points are seen, against traced paths; their derivatives, by differences."""

import numpy as np
import pytest
from scipy.optimize import brentq

from rigs import Camera
from rigs.calibrate.refraction.refraction import Refraction, WindowPrior
from rigs.calibrate.refraction.routes import routes_to
from rigs.scene import Cylinder, Glass, Mirror, Scene, SceneCamera, Sphere, Window

CENTER = np.array([3.0, -2.0, 0.0])
NORMAL = (0.4, 0.1, -0.9)
POINTS = np.random.default_rng(0).uniform([-40, -40, 400], [40, 40, 460], (30, 3))
SCENES = {
    "plate": (Window("w", (5, 3, 300), NORMAL, 10, Glass(1.46)),),
    "water": (Window("w", (5, 3, 300), NORMAL, 10, Glass(1.46), beyond="water"),),
    "two windows": (
        Window("w", (5, 3, 300), NORMAL, 10, Glass(1.46), size=400),
        Window("v", (5, 3, 100), (-0.2, 0.3, -1), 6, Glass(1.52), size=90),
    ),
    "tube": (Cylinder("t", (0, 0, 430), (0, 1, 0.1), 100, 900, Glass(1.5), inner_radius=95),),
    "tank": (
        Cylinder("t", (0, 0, 430), (0, 1, 0), 100, 900, Glass(1.5), inner_radius=95, inside=1.33),
    ),
    "ball": (Sphere("b", (0, 0, 200), 60, Glass(1.1)),),
}


def seen(solids, points=POINTS, center=CENTER, priors=()):
    bending = Refraction.of(Scene(solids), priors)
    routes, _ = routes_to(bending, center, points)
    return bending, routes


@pytest.mark.parametrize("name", SCENES)
def test_directions_are_those_of_traced_paths_within_a_billionth_of_a_pixel(name):
    solids = SCENES[name]
    bending, routes = seen(solids)
    assert (routes >= 0).any(axis=1).all()
    directions = bending.directions(CENTER, POINTS, routes)
    matrix = np.array([[2000.0, 0, 600], [0, 2000, 500], [0, 0, 1]])
    camera = Camera("a", (1200, 1000), matrix, R=np.eye(3), t=-CENTER)
    uv, _, valid = SceneCamera(camera, Scene(solids), (0, 0, 430)).project(POINTS)
    assert valid.all()
    own = directions[:, :2] / directions[:, 2:] * 2000 + [600, 500]
    assert np.abs(own - uv).max() < 1e-9
    paths = Scene(solids).paths(np.tile(CENTER, (len(POINTS), 1)), directions)
    piece = paths.nearest_pieces(POINTS)
    away = POINTS - paths.origins[piece]
    missed = np.linalg.norm(np.cross(away, paths.directions[piece]), axis=1)
    assert missed.max() < 1e-11 * 460


def test_light_from_water_obeys_snells_law():
    """Angles before the glass by a root in one dimension: how far the ray gets along the glass."""
    bending, routes = seen(SCENES["water"])
    directions = bending.directions(CENTER, POINTS, routes)
    into = -np.array(bending.scene.solids[0].normal)
    wall = np.array([5, 3, 300.0])
    indices, thickness = (1.0, 1.46, 1.333), 10.0
    for point, direction in zip(POINTS, directions, strict=True):
        depths = ((wall - CENTER) @ into, thickness, (point - wall) @ into - thickness)
        along = point - CENTER - ((point - CENTER) @ into) * into
        far = np.linalg.norm(along)

        def missing(sine, depths=depths, far=far):
            sines = [sine / index for index in indices]
            parts = (d * s / np.sqrt(1 - s * s) for d, s in zip(depths, sines, strict=True))
            return sum(parts) - far

        sine = brentq(missing, 0, 0.999, xtol=1e-16, rtol=1e-15)
        expected = sine * along / far + np.sqrt(1 - sine**2) * into
        assert np.abs(direction - expected).max() < 1e-13


def test_a_mirror_shows_the_mirrored_point():
    bending = Refraction.of(Scene((Mirror("m", (0, 0, 700), (0, 0, -1)),)))
    directions = bending.directions(CENTER, POINTS, np.zeros((len(POINTS), 1), int))
    mirrored = POINTS * [1, 1, -1] + [0, 0, 1400] - CENTER
    mirrored /= np.linalg.norm(mirrored, axis=1, keepdims=True)
    assert np.abs(directions - mirrored).max() < 1e-14


@pytest.mark.parametrize("name", SCENES)
def test_derivatives_match_differences(name):
    bending, routes = seen(SCENES[name])
    _, by_center, by_point, _ = bending.derivatives(CENTER, POINTS, routes)
    for axis in range(3):
        step = 1e-4 * np.eye(3)[axis]
        ahead, behind = (bending.directions(CENTER + s * step, POINTS, routes) for s in (1, -1))
        scale = np.abs(by_center).max()
        assert np.abs((ahead - behind) / 2e-4 - by_center[:, :, axis]).max() < 1e-7 * scale
        ahead, behind = (bending.directions(CENTER, POINTS + s * step, routes) for s in (1, -1))
        assert np.abs((ahead - behind) / 2e-4 - by_point[:, :, axis]).max() < 1e-7 * scale


@pytest.mark.parametrize("name", ["plate", "water", "two windows"])
def test_derivatives_by_the_window_match_differences(name):
    priors = (WindowPrior("w", 1, 1, 1),)
    bending, routes = seen(SCENES[name], priors=priors)
    by_window = bending.derivatives(CENTER, POINTS, routes)[3]
    for number, size in enumerate([1e-5, 1e-5, 1e-2, 1e-2]):
        step = size * np.eye(4)[number]
        ahead, behind = (
            bending.moved(s * step).directions(CENTER, POINTS, routes) for s in (1, -1)
        )
        numeric = (ahead - behind) / 2 / size
        error = np.abs(numeric - by_window[:, :, number]).max()
        assert error < 1e-6 * max(np.abs(by_window[:, :, number]).max(), 1e-7)
        if name == "plate" and number == 2:  # a plate in one medium does the same anywhere
            assert np.abs(by_window[:, :, 2]).max() < 1e-15


def test_total_reflection_has_no_direction():
    dense = Scene((Window("w", (0, 0, 300), (0.9, 0, -0.2), 10, Glass(1.0)),), medium=1.5)
    bending = Refraction.of(dense)
    routes = np.tile([0, 1], (len(POINTS), 1))
    assert np.isnan(bending.directions(CENTER, POINTS, routes)).all()
