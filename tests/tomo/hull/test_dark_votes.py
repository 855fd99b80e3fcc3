from dataclasses import replace

import numpy as np
import pytest

from rigs import ring
from rigs.lens import Distortion
from tomo import VoxelGrid
from tomo.hull.dark_votes import dark_votes, surface, touched
from tomo.hull.projection_lattice import Lattice, bricks_of
from tomo.rays import Rays
from tomo.trace import trace

GRID = VoxelGrid((9, 14, 6), (0.5, 0.4, 0.7), (3.0, 1.0, -2.0))


def cameras(lens="none", footprint=0.3):
    rig = ring(
        3, distance=30.0, image_size=(40, 48), footprint=footprint, center=GRID.center,
        pitch_degrees=25.0,
    )  # fmt: skip
    shapes = {
        "none": Distortion(),
        "brown": Distortion("brown", (-0.8, 0.3, 0.01, -0.02)),
        "fisheye": Distortion("fisheye", (0.05, -0.02, 0.0, 0.0)),
    }
    return [replace(camera, distortion=shapes[lens]) for camera in rig]


def boxes(camera):
    """Return the exact boxes of all voxels in pixels, from their corners: slow and plain."""
    half = np.array(GRID.spacing) / 2
    signs = np.stack(np.meshgrid(*[[-1, 1]] * 3), -1).reshape(-1, 3)
    corners = GRID.centers().reshape(-1, 1, 3) + signs * half
    uv, _, valid = camera.project(corners.reshape(-1, 3))
    assert valid.all()
    uv = uv.reshape(-1, 8, 2)
    return uv.min(axis=1), uv.max(axis=1)


def is_dark(bright, low, high, grow, beyond):
    """Say whether no bright pixel's area meets a box grown by some pixels; not if it leaves.

    With ``beyond`` the border goes on for ever.
    """
    height, width = bright.shape
    (left, top), (right, bottom) = low - grow, high + grow
    if beyond:
        left, right = np.clip([left, right], -0.5, width - 0.501)
        top, bottom = np.clip([top, bottom], -0.5, height - 0.501)
    if left < -0.5 or top < -0.5 or right > width - 0.5 or bottom > height - 0.5:
        return False
    columns = slice(int(np.floor(left + 0.5)), int(np.floor(right + 0.5)) + 1)
    rows = slice(int(np.floor(top + 0.5)), int(np.floor(bottom + 0.5)) + 1)
    return not bright[rows, columns].any()


@pytest.mark.parametrize("lens", ["none", "brown", "fisheye"])
@pytest.mark.parametrize("margin", [0.0, 2.0])
@pytest.mark.parametrize("footprint", [0.2, 0.3])  # the nearer one cuts the grid off
@pytest.mark.parametrize("beyond", [False, True])
def test_votes_are_those_of_the_exact_boxes(lens, margin, footprint, beyond):
    views = cameras(lens, footprint)
    lattices = [Lattice.of(camera, GRID) for camera in views]
    random = np.random.default_rng(1)
    images = [random.random((48, 40)) < 0.06 / (1 + 2 * margin) for _ in views]
    how = {"margin": margin, "enough": 9, "beyond": beyond}
    votes = dark_votes(images, lattices, GRID.shape, **how).ravel()
    surely, perhaps = np.zeros(GRID.size, int), np.zeros(GRID.size, int)
    for camera, image in zip(views, images, strict=True):
        for voxel, (low, high) in enumerate(zip(*boxes(camera), strict=True)):
            surely[voxel] += is_dark(image, low, high, margin + 0.5, beyond)
            perhaps[voxel] += is_dark(image, low, high, margin, beyond)
    assert (votes <= perhaps).all()
    assert (votes >= surely).all()
    assert 0.05 < (votes > 1).mean() < 0.95


def test_counting_ends_when_enough_agree():
    views = cameras()
    lattices = [Lattice.of(camera, GRID) for camera in views]
    images = [np.random.default_rng(n).random((48, 40)) > 0.97 for n in range(3)]
    every = dark_votes(images, lattices, GRID.shape, margin=0, enough=9)
    two = dark_votes(images, lattices, GRID.shape, margin=0, enough=2)
    np.testing.assert_array_equal(two >= 2, every >= 2)
    assert two.max() == 2


@pytest.mark.parametrize("lens", ["none", "brown", "fisheye"])
def test_every_pixel_whose_ray_meets_a_live_voxel_is_touched(lens):
    views = cameras(lens, 0.2)
    active = np.zeros(GRID.shape, bool)
    active[2:7, 3:9, 1:4] = True
    active[8, 13, 5] = True
    shapes = [(48, 40)] * 3
    for camera, found in zip(
        views, touched(active, [Lattice.of(c, GRID) for c in views], shapes), strict=True
    ):
        segments = trace(Rays.from_camera(camera, supersample=3), GRID)
        meets = np.add.reduceat(active.ravel()[segments.voxel], segments.ptr[:-1].clip(
            max=len(segments) - 1)) > 0  # fmt: skip
        meets &= np.diff(segments.ptr) > 0
        meets = meets.reshape(48, 40)
        assert (found | ~meets).all()
        assert found.sum() < 2.0 * meets.sum()


def test_a_camera_that_does_not_see_all_bricks_touches_everything():
    camera = cameras()[0]
    inside = replace(camera, t=camera.R @ -np.array(GRID.center))
    lattice = Lattice.of(inside, GRID)
    assert np.isnan(lattice.corners).any()
    active = np.zeros(GRID.shape, bool)
    assert not touched(active, [lattice], [(48, 40)])[0].any()
    active[0, 0, 0] = True
    assert touched(active, [lattice], [(48, 40)])[0].all()
    dark = [np.zeros((48, 40), bool)]
    assert dark_votes(dark, [lattice], GRID.shape, margin=0, enough=1).mean() < 1


def test_the_surface():
    active = np.ones((4, 5, 6), bool)
    expected = active.copy()
    expected[1:-1, 1:-1, 1:-1] = False
    np.testing.assert_array_equal(surface(active), expected)
    active[1, 2, 2] = False
    assert surface(active)[2, 2, 2]
    thin = np.ones((1, 5, 6), bool)
    assert surface(thin).all()


@pytest.mark.parametrize("lens", ["none", "brown", "fisheye"])
def test_positions_between_the_corners_are_within_the_slack(lens):
    camera = cameras(lens)[1]
    lattice = Lattice.of(camera, GRID)
    bricks = bricks_of(GRID.shape)
    place = np.random.default_rng(0).random((200, 3)) * bricks
    whole = np.minimum(place.astype(int), np.array(bricks) - 1)
    part = place - whole
    mean = np.zeros((200, 2))
    for corner in np.ndindex(2, 2, 2):
        weight = np.prod(np.where(corner, part, 1 - part), axis=1)
        mean += weight[:, None] * lattice.corners[tuple((whole + corner).T)]
    exact, _, _ = camera.project(GRID.lower + place * 4 * np.array(GRID.spacing))
    assert np.abs(mean - exact).max() <= lattice.slack < 0.2
