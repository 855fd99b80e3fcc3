import numpy as np
import pytest

import rigs
from tomo import VoxelGrid
from tomo.selfcal.refine import prior_lengths
from tomo.selfcal.refine.parameters import COUNT, image_derivatives, moved, volume_gradient
from tomo.selfcal.refine.prior import units

GRID = VoxelGrid((20, 28, 20), 0.5)


def ring(count=5, size=(40, 56)):
    pitch = [9, -14, 3, 20, -6][:count]
    return rigs.ring(count, distance=300, image_size=size, footprint=0.4, pitch_degrees=pitch)


def blobs(points):
    """Return two Gaussians, well inside the grid, at the points."""
    middles, widths = np.array([[1.0, 2, -1], [-1.5, -2, 1]]), np.array([1.4, 1.1])
    apart = ((points[:, None] - middles) ** 2).sum(-1)
    return np.exp(-0.5 * apart / widths**2).sum(-1)


def line_integrals(camera, uv):
    """The blobs' exact integrals along the rays of pixels."""
    origins, directions = camera.rays(uv)
    total = np.zeros(len(uv))
    for middle, width in (((1.0, 2, -1), 1.4), ((-1.5, -2, 1), 1.1)):
        apart = np.array(middle) - origins
        across = (apart**2).sum(-1) - (apart * directions).sum(-1) ** 2
        total += np.exp(-0.5 * across / width**2) * width * np.sqrt(2 * np.pi)
    return total


@pytest.mark.parametrize("which", range(7))
def test_derivatives_are_those_of_exact_line_integrals(which):
    """The projected derivative volume against finite differences of Gaussians' integrals."""
    from tomo.operators import LinearSystem

    rig = ring(1)
    camera, grid = rig[0], GRID.refined(2)
    system = LinearSystem.from_rig(rig, grid, skip=False, supersample=2)
    gradient = volume_gradient(blobs(grid.centers().reshape(-1, 3)), grid)
    derivatives = image_derivatives(
        lambda field: system.projector @ field, camera, gradient, grid.centers().reshape(-1, 3)
    )
    pixel = units(camera, grid)  # moving forward changes next to nothing: compare with sideways
    step = np.zeros(COUNT)
    step[which] = 1e-3 * pixel[which]
    uv = np.stack(np.divmod(np.arange(40 * 56), 40)[::-1], axis=-1)
    there = line_integrals(moved(camera, step), uv), line_integrals(moved(camera, -step), uv)
    exact = (there[0] - there[1]) / (2 * step[which])
    sideways = np.linalg.norm(derivatives[0] * pixel[0])
    assert np.linalg.norm(derivatives[which] - exact) * pixel[which] < 0.06 * sideways
    if which != 2:
        assert np.linalg.norm(exact) * pixel[which] > 0.5 * sideways


def test_a_unit_of_each_parameter_moves_the_image_by_about_a_pixel():
    camera = ring(1)[0]
    points = GRID.centers().reshape(-1, 3)[::7]
    here = camera.project(points)[0]
    for which in (0, 1, 3, 4, 5, 6):
        step = np.zeros(COUNT)
        step[which] = units(camera, GRID)[which]
        there = moved(camera, step).project(points)[0]
        assert np.sqrt(((there - here) ** 2).sum(1).mean()) == pytest.approx(1, rel=0.1)


def test_moving_and_shrinking_commute():
    camera = ring(1)[0]
    step = np.array([1.0, -2, 3, 0.01, -0.02, 0.03, 0.05, 0.1])
    one, other = moved(camera, step).shrunk(2), moved(camera.shrunk(2), step)
    points = GRID.centers().reshape(-1, 3)[::97]
    assert np.allclose(one.project(points)[0], other.project(points)[0], atol=1e-9)


def test_gradient_of_a_linear_field_is_exact_inside():
    centers = GRID.centers()
    field = centers @ [1.0, -2.0, 0.5]
    found = volume_gradient(field, GRID).reshape(*GRID.shape, 3)[1:-1, 1:-1, 1:-1]
    assert np.allclose(found, [1.0, -2.0, 0.5])


def test_priors_come_from_calibration_and_status():
    from dataclasses import replace

    rig = ring(3)
    figures = {"cameras": {"cam00": {"ray_miss": 0.04}, "cam01": {"ray_miss": None}}}
    cameras = (rig[0], rig[1], replace(rig[2], status="nominal"))
    known = replace(rig, cameras=cameras, calibration=figures)
    assert prior_lengths(known, GRID) == pytest.approx([3 * 0.04 / 0.4, 2, 10])
    assert prior_lengths(replace(known, calibration={"cameras": 3}), GRID).tolist() == [2, 2, 10]
    other_unit = replace(known, calibration={**figures, "length_unit": "m"})
    assert prior_lengths(other_unit, GRID).tolist() == [2, 2, 10]
