"""Tracers and projectors where coordinates, sizes and rays are at their worst.

Bounds are roundings of float64: of the farthest coordinate in voxels where that is what is known
of a ray, of the result where everything is measured from the grid.
"""

from dataclasses import dataclass, replace
from itertools import permutations

import numpy as np
import pytest

import rigs
from rigs import Camera, Distortion, look_at
from tomo import LinearSystem, Projector, VoxelGrid, dot_test
from tomo.operators.on_the_fly import OnTheFlyProjector
from tomo.operators.on_the_fly.camera_sources import pixel_source
from tomo.rays import Rays
from tomo.solvers import cgls
from tomo.trace import TRACERS, trace

EPS = float(np.finfo(np.float64).eps)
SHAPE = (20, 14, 17)
STEEPEST = 0.05  # least share of a ray's direction along any axis where voxels are compared
CHORD_ROUNDINGS = 4.0  # of the farthest coordinate: sums of chords against the ray's length
VOXEL_ROUNDINGS = 8.0  # of it, by which two tracers may place a crossing differently
COUNT = 60  # rays of a case


@dataclass(frozen=True)
class Case:
    """A grid with rays; those hardly tilted from a face change sides where rounding makes them."""

    name: str
    grid: VoxelGrid
    rays: Rays
    tilted: bool = False

    @property
    def rounding(self):
        """Return how coarse world coordinates are, in voxels: of the farthest origin or corner."""
        reach = np.maximum(np.abs(self.rays.origins).max(axis=0), np.abs(self.grid.center))
        from_grid = np.abs(self.rays.origins - self.grid.center).max(axis=0) + self.grid.extent
        return EPS * float((np.maximum(reach, from_grid) / self.grid.spacing).max())


def through(grid, n, random, distance):
    """Return rays to points in the grid from so many voxels away, nowhere near parallel to one."""
    target = random.uniform(0.02, 0.98, (n, 3)) * grid.extent + grid.lower
    away = random.uniform(STEEPEST, 1, (n, 3)) * random.choice([-1.0, 1.0], (n, 3))
    away = away / np.linalg.norm(away, axis=1, keepdims=True) * grid.spacing
    return Rays.from_lines(target - distance * away, away)


def grids():
    """Yield a name, a grid, and from how many voxels away rays come."""
    for distance in (0, 1, 1e2, 1e4, 1e6, 1e8):
        yield f"{distance:g} voxels away", VoxelGrid(SHAPE, 0.5, (1, 2, 3)), distance
    for size in (1e-9, 1e-3, 1e3, 1e9):
        yield f"voxels of {size:g}", VoxelGrid(SHAPE, size, (3 * size, -2 * size, size)), 50
    for off in (1e3, 1e5, 1e7):
        for toward in ((1, 0, 0), (-0.6, 0.3, 1)):
            center = tuple(off * 0.1 * np.array(toward))
            yield f"{off:g} voxels off to {toward}", VoxelGrid(SHAPE, 0.1, center), 50
    for pattern in range(1, 7):
        spacing = tuple(1e3 if pattern >> axis & 1 else 1.0 for axis in range(3))
        yield f"voxels of {spacing}", VoxelGrid(SHAPE, spacing, (5, 5, 5)), 50
    for shape in thin_shapes():
        yield f"grid of {shape}", VoxelGrid(shape, (0.3, 0.5, 0.7), (1, -1, 2)), 30


def thin_shapes():
    """Return shapes of one voxel along one, two and all axes."""
    return [
        tuple(side if pattern >> axis & 1 else 1 for axis, side in enumerate(SHAPE))
        for pattern in range(7)
    ]


def special_rays():
    """Yield rays along faces, edges and axes, through corners, with subnormal directions."""
    random, n = np.random.default_rng(1), COUNT
    for grid in (
        VoxelGrid((8, 6, 10), 0.5, (1, 2, 3)),  # exact in binary
        VoxelGrid((7, 9, 5), 0.1, (333.3, -77.7, 5.5)),
        VoxelGrid((1, 9, 8), (0.3, 0.7, 1e-3)),
    ):
        number = np.stack([random.integers(0, m + 1, n) for m in grid.shape], axis=1)
        corner = np.where(number == grid.shape, grid.upper, grid.lower + number * grid.spacing)
        inside = random.uniform(grid.lower, grid.upper, (n, 3))
        axis = np.eye(3)[random.integers(0, 3, n)] * random.choice([-1.0, 1.0], (n, 1))
        in_plane = random.standard_normal((n, 3)) * (random.random((n, 3)) > 0.4)
        in_plane[~in_plane.any(axis=1)] = (0, 0, -1)
        between_corners = random.integers(-1, 2, (n, 3)) * np.array(grid.spacing)
        between_corners[~between_corners.any(axis=1)] = (1, 0, 0)
        subnormal = axis + random.choice([5e-324, 1e-310, -5e-324, 1e-300, -1e-200, 0], (n, 3))
        tilt = axis + random.choice([-1, 1], (n, 3)) * 10.0 ** random.uniform(-18, -6, (n, 3))
        for name, points, directions in (
            ("axis-parallel", inside, axis),
            ("along edges", corner, axis),
            ("in faces", corner, in_plane),
            ("from corner to corner", corner, between_corners),
            ("with subnormal parts", inside, subnormal),
            ("along edges with subnormal parts", corner, subnormal),
            ("hardly tilted from edges", corner, tilt),
        ):
            unit = directions / np.linalg.norm(directions, axis=1, keepdims=True)
            back = random.choice([0.0, 16.0, 2.0**20], (n, 1))
            rays = Rays.from_lines(points - back * unit, unit)
            yield Case(f"{name}, {grid.shape}", grid, rays, tilted=directions is tilt)


def cases():
    random = np.random.default_rng(0)
    found = [Case(name, grid, through(grid, COUNT, random, away)) for name, grid, away in grids()]
    return [*found, *special_rays()]


def chord(case, outward=0.0):
    """Return the length (rays,) of each ray in the box whose faces move ``outward`` voxels.

    By the slab method in world coordinates and extended precision, which no tracer uses.
    """
    rays, grid = case.rays, case.grid
    origin, direction = rays.origins.astype(np.longdouble), rays.directions.astype(np.longdouble)
    margin = np.longdouble(outward) * np.longdouble(grid.spacing)
    half = np.longdouble(grid.shape) * np.longdouble(grid.spacing) / 2
    low, high = grid.center - half - margin - origin, grid.center + half + margin - origin
    still = np.abs(direction) < 1e-300  # moves it within no box that there is
    divisor = np.where(still, 1, direction)
    between = (low <= 0) & (high >= 0)
    ends = np.stack([low / divisor, high / divisor])
    near = np.where(still, np.where(between, -np.inf, np.inf), ends.min(axis=0))
    far = np.where(still, np.where(between, np.inf, -np.inf), ends.max(axis=0))
    start = np.maximum(near.max(axis=1), 0)
    return np.maximum(np.minimum(far.min(axis=1), rays.lengths) - start, 0).astype(np.float64)


def assert_sums_are_chords(case, total):
    """Compare sums of chords (rays,) with those of boxes a few roundings smaller and larger."""
    outward = CHORD_ROUNDINGS * case.rounding
    slack = 8 * EPS * max(float(chord(case).max(initial=0.0)), 1e-300)  # of adding them up
    assert (total <= chord(case, outward) + slack).all()
    assert (total >= chord(case, -outward) - slack).all()


def matrix_of(projector):
    matrix = projector.to_scipy().copy()
    matrix.sum_duplicates()
    return matrix


@pytest.mark.parametrize("case", cases(), ids=lambda case: case.name)
def test_tracers_and_projectors_hold_at_the_worst(case):
    grid, rays = case.grid, case.rays
    stored = {t: Projector(trace(rays, grid, t, dtype=np.float64), grid) for t in TRACERS}
    flying, single = OnTheFlyProjector(rays, grid), Projector(trace(rays, grid), grid)
    for one in (*stored.values(), flying):
        assert_sums_are_chords(case, one.row_sums)
    for one in (single, flying):
        assert dot_test(one, 1, np.float64) < 1e-12
        assert dot_test(one, 1, np.float32) < 1e-6
    if case.tilted:
        return
    reference = stored["reference"]
    unit = case.rounding / STEEPEST  # what rounding moves a crossing by, along the ray
    matrix, random = matrix_of(reference), np.random.default_rng(0)
    most = VOXEL_ROUNDINGS * unit
    for name in ("march", "raycast"):
        apart = abs(matrix_of(stored[name]) - matrix).max()
        assert apart <= most * max(float(matrix.max()), 1e-300)
    x, y = random.random(reference.shape[1]), random.random(reference.shape[0])
    images, volume = reference @ x, reference.T @ y
    for one in (stored["march"], flying):
        assert np.abs(one @ x - images).max() <= most * max(images.max(), 1e-300)
        assert np.abs(one.T @ y - volume).max() <= most * max(volume.max(), 1e-300)


@pytest.fixture(scope="module")
def world():
    """Return a grid, rays through it, and a volume."""
    random = np.random.default_rng(0)
    grid = VoxelGrid(SHAPE, 0.3, (1, 2, 3))
    return grid, through(grid, 300, random, 50), random.random(SHAPE)


FORMS = {
    "stored": lambda rays, grid: Projector(trace(rays, grid, dtype=np.float64), grid),
    "on the fly": OnTheFlyProjector,
}
every_form = pytest.mark.parametrize("form", FORMS)


def apart(found, expected):
    return np.linalg.norm(found - expected) / np.linalg.norm(expected)


@every_form
@pytest.mark.parametrize("power", [-30, -10, 10, 30])
def test_lengths_times_a_power_of_two_have_the_same_digits(world, form, power):
    grid, rays, volume = world
    factor = 2.0**power
    scaled = VoxelGrid(SHAPE, 0.3 * factor, tuple(factor * np.asarray(grid.center)))
    images = FORMS[form](rays, grid) @ volume.ravel()
    found = FORMS[form](replace(rays, origins=rays.origins * factor), scaled) @ volume.ravel()
    np.testing.assert_array_equal(found, images * factor)


@every_form
def test_axes_renamed_or_mirrored_and_rays_reversed_change_nothing(world, form):
    grid, rays, volume = world
    images = FORMS[form](rays, grid) @ volume.ravel()
    for order in permutations(range(3)):
        axes = list(order)
        sizes = (tuple(np.asarray(v)[axes]) for v in (grid.shape, grid.spacing, grid.center))
        other = replace(rays, origins=rays.origins[:, axes], directions=rays.directions[:, axes])
        found = FORMS[form](other, VoxelGrid(*sizes)) @ volume.transpose(axes).ravel()
        assert apart(found, images) < 1e-12
    for axis in range(3):
        sign = np.where(np.arange(3) == axis, -1.0, 1.0)
        other = replace(rays, origins=rays.origins * sign, directions=rays.directions * sign)
        mirrored = replace(grid, center=tuple(sign * grid.center))
        assert apart(FORMS[form](other, mirrored) @ np.flip(volume, axis).ravel(), images) < 1e-12
    ends = rays.origins + 120 * rays.directions
    back = replace(rays, origins=ends, directions=-rays.directions)
    assert apart(FORMS[form](back, grid) @ volume.ravel(), images) < 1e-12


@every_form
@pytest.mark.parametrize("voxels", [1e2, 1e5, 1e7])
def test_the_world_moved_with_everything_in_it_is_the_same_to_rounding(world, form, voxels):
    _, _, volume = world
    random = np.random.default_rng(1)
    grid = VoxelGrid(SHAPE, 0.5)
    rays, shift = through(grid, 300, random, 50), 0.5 * voxels * random.standard_normal(3)
    images = FORMS[form](rays, grid) @ volume.ravel()
    moved = FORMS[form](
        replace(rays, origins=rays.origins + shift), VoxelGrid(SHAPE, 0.5, tuple(shift))
    )
    rounding = EPS * np.abs(shift).max() / 0.5
    assert apart(moved @ volume.ravel(), images) < 8 * rounding


@every_form
@pytest.mark.parametrize("shape", thin_shapes(), ids=str)
def test_thin_grids_give_the_same_bits_on_any_number_of_threads(on_threads, form, shape):
    random = np.random.default_rng(2)
    grid = VoxelGrid(shape, (0.3, 0.5, 0.7), (1, -1, 2))
    A = FORMS[form](through(grid, 100, random, 30), grid)
    x, y = random.random(grid.size), random.random(100)
    found = []
    for threads in (1, 2):
        with on_threads(threads):
            found.append((A @ x, A.T @ y))
    for one, other in zip(*found, strict=True):
        np.testing.assert_array_equal(one, other)


STRONG = {
    "none": Distortion(),
    "barrel": Distortion("brown", (-0.35, 0.15, 0.01, -0.02, 0)),
    "pincushion": Distortion("brown", (2.0, 1.0, 0, 0, 0)),
    "rational": Distortion("rational", (8, 5, 0.01, 0.01, 1, 9, 6, 1.5)),
    "prism": Distortion("thin_prism", (-0.3, 0.1, 0.01, 0.01, *[0] * 4, 0.05, -0.02, 0.03, 0.01)),
    "tilted by 80 degrees": Distortion("tilted", (0,) * 12 + (1.4, -0.2)),
    "fisheye": Distortion("fisheye", (0.1, 0.05, 0, 0)),
}


@pytest.mark.parametrize("lens", STRONG)
@pytest.mark.parametrize(
    ("distance", "focal"), [(0, 20.0), (3, 20.0), (60, 70.0), (1e4, 1.2e4), (1e8, 1.2e8)]
)
def test_rays_of_strong_lenses_made_at_every_product_are_the_stored_ones(lens, distance, focal):
    grid = VoxelGrid((30, 25, 28), 1.0, (2, 3, 4))
    center = np.asarray(grid.center)
    position = center + np.array([0.6, 0.5, 0.62]) * distance
    R, t = look_at(position, center if distance else center + np.array([1, 0.3, 0.2]))
    matrix = [[focal, 0, 31.5], [0, focal, 31.5], [0, 0, 1]]
    camera = Camera("camera", (64, 64), matrix, STRONG[lens], R, t)
    x = (1 + np.sin(np.linspace(0, 9, grid.size))) * np.linspace(1, 2, grid.size)
    flying = OnTheFlyProjector([pixel_source(camera)], grid)
    images = Projector(trace(Rays.from_camera(camera), grid, dtype=np.float64), grid) @ x
    assert np.abs(flying @ x - images).max() < 1e-5 * images.max()
    assert dot_test(flying) < 1e-11


def test_ever_farther_cameras_lead_to_the_volume_of_parallel_rays():
    """At half the side n / 2 from the axis, a ray from D voxels away leans by n / 2 D.

    Over half the side it comes to lie n² / 4 D voxels from a parallel one.
    """
    grid = VoxelGrid((16, 20, 16), 1.0)
    truth = np.exp(-(np.linalg.norm(grid.centers() / (5, 6, 5), axis=-1) ** 2)).ravel()
    volumes = {}
    for distance in (1e4, 1e6, 1e8):
        rig = rigs.ring(5, distance=distance, image_size=(24, 28), footprint=1.0, pitch_degrees=10)
        A = LinearSystem.from_rig(rig, grid, skip=False).projector
        volumes[distance] = cgls(A, A @ truth, iterations=8).volume
    for distance in (1e4, 1e6):
        off = apart(volumes[distance], volumes[1e8].astype(np.float64))
        assert off * distance < max(grid.shape) ** 2 / 4
