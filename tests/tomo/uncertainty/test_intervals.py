"""90 % intervals: the jackknife, what intervals follow, and the quantities of a whole volume."""

import itertools

import numpy as np
import pytest

from phantoms import create, sample
from rigs import ring
from tomo import LinearSystem, VoxelGrid, load_scan, reconstruct, solvers
from tomo.grid import ActiveVoxels
from tomo.simulation import camera_noise as noises
from tomo.simulation import simulate_images
from tomo.uncertainty import assess, jackknife, summaries
from tomo.uncertainty.intervals import NORMAL
from tomo.uncertainty.jackknife import GROUPS, Jackknife, view_groups

GRID = VoxelGrid((12, 14, 12), 1.0, (1.0, -2.0, 0.5))


def system_of(cameras, grid=GRID):
    rig = ring(
        cameras,
        distance=200.0,
        image_size=(30, 34),
        footprint=0.6,
        pitch_degrees=10.0,
        center=grid.center,
    )
    return LinearSystem.from_rig(rig, grid)


def flame(grid=GRID):
    """Two blobs of unlike width, away from the grid's faces."""
    x, y, z = np.moveaxis(grid.centers() - grid.center, -1, 0)
    wide = np.exp(-((x - 1) ** 2 + (y / 1.5) ** 2 + z**2) / 8)
    return (wide + np.exp(-((x + 2) ** 2 + (y - 2) ** 2 + (z - 1) ** 2) / 2)).astype(np.float32)


def images_of(system, seed=3, noise=0.01):
    clean = (system.projector @ flame(system.projector.grid).ravel()).astype(np.float32)
    return system.flatten(
        noises.gaussian(system.images(clean), noise, np.random.default_rng(seed))
    )


def solver(system, iterations=15):
    def solve(measured, views=None):
        part, pixels = system.projector, measured
        if views is not None:
            part = system.projector.subset(views)
            pixels = measured[system.projector.pixels_of(views)]
        found = solvers.tikhonov(part, pixels, strength=1e-3, iterations=iterations)
        return system.projector.active.compress(found.volume)

    return solve


def assessed(system, measured, solve=None, repeats=3):
    solve = solver(system) if solve is None else solve
    volume = solve(measured).reshape(system.projector.grid.shape)
    return assess(system, measured, volume, solve, by_views=solve, repeats=repeats)


@pytest.fixture(scope="module")
def found():
    system = system_of(8)
    return assessed(system, images_of(system))


@pytest.mark.parametrize(
    ("cameras", "groups"), [(2, 0), (3, 3), (5, GROUPS), (8, GROUPS), (13, GROUPS)]
)
def test_every_view_is_left_out_once_and_neighbours_apart(cameras, groups):
    found = view_groups(system_of(cameras))
    assert len(found) == groups
    if groups:
        assert sorted(view for group in found for view in group) == list(range(cameras))
        assert max(map(len, found)) - min(map(len, found)) <= 1
    assert not any(b - a == 1 for group in found for a, b in itertools.pairwise(group))


def test_the_jackknife_of_a_mean_is_its_standard_error():
    """One value a view: the deviation of their mean is theirs over the root of their number."""
    values = np.random.default_rng(2).standard_normal(GROUPS)
    whole = values.mean()
    parts = np.array([np.delete(values, n).mean() for n in range(GROUPS)])
    found = Jackknife([[n] for n in range(GROUPS)], parts[:, None].astype(np.float32))
    exact = values.std(ddof=1) / GROUPS**0.5
    assert found.deviation(whole, parts) == pytest.approx(exact, rel=1e-12)


def test_views_that_agree_leave_nothing_and_a_camera_that_lies_a_lot():
    """A least-squares solve of overdetermined clean images does not hang on any camera."""
    grid = VoxelGrid((5, 6, 5), 2.0, GRID.center)
    system = system_of(12, grid)
    truth = flame(grid).ravel()
    columns = np.stack([system.projector @ e for e in np.eye(grid.size, dtype=np.float32)], 1)

    def solve(measured, views=None):
        rows = slice(None) if views is None else system.projector.pixels_of(views)
        return np.linalg.lstsq(columns[rows], measured[rows], rcond=None)[0].astype(np.float32)

    clean = (columns @ truth).astype(np.float32)
    agreed = jackknife(system, clean, solve)
    exact = agreed.deviation(truth, agreed.volumes)
    assert exact.max() < 1e-3
    wrong = clean.copy()
    wrong[system.projector.pixels_of([4])] *= 1.3
    lying = jackknife(system, wrong, solve)
    spread = lying.deviation(solve(wrong), lying.volumes)
    assert np.median(spread) > 20 * np.median(exact)
    moved = np.abs(lying.volumes - truth).mean(axis=1)
    assert int(np.argmin(moved)) == next(n for n, g in enumerate(lying.groups) if 4 in g)


@pytest.mark.parametrize(
    ("name", "cameras", "noise", "widest"),
    [("turbulent", 7, 0.01, 5), ("jet", 12, 0.0, 8)],  # clean images of a smooth flame: too wide
)
def test_the_truth_is_inside_the_intervals_of_the_default(tmp_path, name, cameras, noise, widest):
    """Flames that the constants were not settled on, where noise is the smaller part or none."""
    grid = VoxelGrid((16, 22, 16), 1.0)
    rig = ring(cameras, distance=200.0, image_size=(48, 64), footprint=0.5, pitch_degrees=10.0)
    field = create(name, 1, grid.extent, grid.center)
    images = simulate_images(rig, field, grid, supersample=2, refine=2, noise=noise)
    outcome = reconstruct(load_scan(images.save(tmp_path / "scan")))
    emitting = outcome.truth > 0.02 * outcome.truth.max()
    error = np.abs(outcome.volume - outcome.truth)[emitting]
    half = outcome.uncertainty.half_width[emitting]
    deviation = outcome.uncertainty.standard_deviation[emitting]
    assert np.mean(error <= half) >= 0.85
    assert np.mean(error <= NORMAL * deviation) < 0.5
    assert np.median(half) < widest * np.median(error)


def test_noise_and_structure_add_in_squares(found):
    parts = found.intervals
    assert parts.noise == pytest.approx(NORMAL * found.deviations.values, rel=1e-5)
    squares = np.hypot(parts.noise, parts.structure)
    assert parts.together == pytest.approx(squares, rel=1e-4, abs=1e-6)


def test_what_views_add_shows_when_they_are_left_out():
    """A rough flame: without a sixth of many cameras little changes, without one of few a lot."""
    field = create("turbulent", 1, GRID.extent, GRID.center)
    truth = sample(field, GRID, 4).astype(np.float32).ravel()
    spread, errors = [], []
    for system in (system_of(12), system_of(3)):
        solve = solver(system, 40)
        clean = (system.projector @ truth).astype(np.float32)
        volume = solve(clean)
        found = jackknife(system, clean, solve)
        spread.append(np.median(found.deviation(volume, found.volumes)))
        errors.append(np.median(np.abs(volume - truth)))
    assert errors[1] > 2 * errors[0]
    assert spread[1] > 2 * spread[0]


def test_twice_the_light_has_twice_the_intervals(found):
    system = system_of(8)
    double = assessed(system, 2 * images_of(system))
    assert double.intervals.together == pytest.approx(2 * found.intervals.together, rel=1e-2)
    report, twice = (one.report()["intervals"] for one in (found, double))
    assert twice["voxels"]["relative"] == pytest.approx(report["voxels"]["relative"], rel=1e-2)
    assert twice["edges"]["half_width"] == pytest.approx(
        np.array(report["edges"]["half_width"]), rel=1e-2
    )


def test_total_planes_and_edges_are_inside(found):
    true = summaries.split(summaries.all_of(flame(), GRID), GRID)
    for name, value in true.items():
        off = np.abs(found.intervals.values[name] - value)
        assert np.mean(off <= found.intervals.half_widths[name]) >= 0.8
    half = found.intervals.half_widths["total"]
    assert half < 0.1 * true["total"]
    assert (found.intervals.noise_of_values["total"] <= half).all()


def test_a_total_hangs_on_light_that_no_projection_has():
    """A background in all images: the total is not what it seems, and its interval says so."""
    system = system_of(8)
    measured = images_of(system)
    plain = assessed(system, measured)
    lit = assessed(system, measured + 0.3 * measured.max())
    relative = [
        one.intervals.half_widths["total"] / one.intervals.values["total"] for one in (plain, lit)
    ]
    assert relative[1] > 3 * relative[0]


def test_without_enough_cameras_there_are_no_intervals():
    system = system_of(2)
    found = assessed(system, images_of(system))
    assert found.intervals is None
    assert found.half_width is None
    assert found.report()["intervals"] is None


def test_the_same_seed_gives_the_same_intervals(found):
    system = system_of(8)
    again = assessed(system, images_of(system))
    assert again.half_width.tobytes() == found.half_width.tobytes()


def test_edges_are_where_plane_sums_are_half():
    grid = VoxelGrid((10, 8, 6), (1.0, 2.0, 0.5), (0.5, 1.0, -1.0))
    volume = np.zeros(grid.shape, np.float32)
    volume[3:7, 2:5, :] = 2.0
    found = summaries.edges(volume, grid)
    assert found[0] == pytest.approx([grid.lower[0] + 3, grid.lower[0] + 7])
    assert found[1] == pytest.approx([grid.lower[1] + 4, grid.lower[1] + 10])
    assert found[2] == pytest.approx([grid.lower[2], grid.upper[2]])  # it goes on beyond both
    assert np.isnan(summaries.edges(np.zeros_like(volume), grid)).all()


def test_plane_sums_and_total_are_integrals():
    grid = VoxelGrid((4, 5, 6), (1.0, 2.0, 0.5))
    volume = np.random.default_rng(1).random(grid.shape).astype(np.float32)
    named = summaries.split(summaries.of_unknowns(volume.ravel(), ActiveVoxels(grid)), grid)
    whole = volume.sum(dtype=np.float64) * 1.0
    assert named["total"] == pytest.approx(whole)
    for axis, name in enumerate("xyz"):
        assert named[f"plane_sums_{name}"].shape == (grid.shape[axis],)
        assert named[f"plane_sums_{name}"].sum() * grid.spacing[axis] == pytest.approx(whole)
