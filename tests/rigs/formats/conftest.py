import json
import sys
from pathlib import Path

import numpy as np
import pytest

from rigs import Camera, Distortion, Rig, formats, look_at

sys.path.append(str(Path(__file__).parent))  # the tests import `lens_formulas`
from lens_formulas import COEFFICIENTS


@pytest.fixture(scope="session")
def make_rig():
    """Return a function: a rig of one camera for each lens named, somewhere round the origin."""

    def make(*models, seed=0, skew=0.0):
        rng = np.random.default_rng(seed)
        cameras = []
        for index, model in enumerate(models):
            R, t = look_at(rng.normal(size=3) * 400, rng.normal(size=3) * 5, rng.normal(size=3))
            K = [
                [rng.uniform(800, 900), skew, 321.3],
                [0, rng.uniform(800, 900), 238.4],
                [0, 0, 1],
            ]
            lens = Distortion(model, COEFFICIENTS[model])
            cameras.append(Camera(f"cam{index}", (640, 480), K, lens, R, t, status="calibrated"))
        return Rig(tuple(cameras), "unit")

    return make


@pytest.fixture(scope="session")
def assert_same_views():
    """Return a function: 200 points of each camera's view appear within 1e-6 px in the other."""

    def check(found, expected, names=None):
        assert found.names == (names or expected.names)
        rng = np.random.default_rng(1)
        for camera, truth in zip(found, expected, strict=True):
            assert camera.image_size == truth.image_size
            size = np.array(truth.image_size)
            origins, directions = truth.rays(rng.uniform(0, 1, (200, 2)) * (size - 1))
            points = origins + directions * rng.uniform(50, 800, (200, 1))
            uv, depth, valid = camera.project(points)
            expected_uv, expected_depth, _ = truth.project(points)
            assert valid.all()
            np.testing.assert_allclose(uv, expected_uv, rtol=0, atol=1e-6)
            np.testing.assert_allclose(depth, expected_depth, rtol=1e-9)

    return check


@pytest.fixture(scope="session")
def assert_projects():
    """Return a function: 200 points in a camera's view are projected as ``formula(points)`` does.

    The formula is the format's own, on points ``(N, 3)`` in the world of the file.
    """

    def check(camera, formula):
        size = np.array(camera.image_size)
        rng = np.random.default_rng(7)
        origins, directions = camera.rays(rng.uniform(0.02, 0.98, (200, 2)) * (size - 1))
        points = origins + directions * rng.uniform(50, 800, (200, 1))
        uv, _, valid = camera.project(points)
        assert valid.all()
        np.testing.assert_allclose(uv, formula(points), rtol=0, atol=1e-6)

    return check


@pytest.fixture(scope="session")
def mutated():
    """Return a function: a copy of plain data with another value at a path; None deletes it."""

    def change(data, path, value):
        data = json.loads(json.dumps(data))
        inner = data
        for key in path[:-1]:
            inner = inner[key]
        if value is None:
            del inner[path[-1]]
        else:
            inner[path[-1]] = value
        return data

    return change


@pytest.fixture(scope="session")
def refused_as():
    """Return a function: loading, by the further arguments, ends in one line on a file."""

    def check(file, message, *arguments, **options):
        with pytest.raises(ValueError) as caught:  # noqa: PT011
            formats.load(*arguments, **options)
        assert str(caught.value).startswith(f"{file}: ")
        assert message in str(caught.value)
        assert "\n" not in str(caught.value)

    return check
