import numpy as np
import pytest

from phantoms import GaussianBlobs, create
from rigs import ring
from tomo import LinearSystem, VoxelGrid, solvers
from tomo.simulation import camera_noise as noises
from tomo.simulation import simulate_images
from tomo.uncertainty import (
    assess,
    noise_of_images,
    resolution,
    standard_deviations,
    view_coverage,
)
from tomo.uncertainty.moved import solve_moved
from tomo.uncertainty.part import whole

GRID = VoxelGrid((10, 14, 10), 1.0, (1.0, -2.0, 0.5))


def system_of(cameras, grid=GRID, finer=1, **how):
    rig = ring(
        cameras,
        distance=200.0,
        image_size=(28 * finer, 36 * finer),
        footprint=0.5 / finer,
        center=grid.center,
        **how,
    )
    return LinearSystem.from_rig(rig, grid)


def images_of(system, grid=GRID, field=None):
    field = create("turbulent", 1, grid.extent, grid.center) if field is None else field
    found = simulate_images(system.rig, field, grid, supersample=2, refine=2)
    return list(found.images.values())


@pytest.fixture(scope="module")
def system():
    return system_of(7, pitch_degrees=[10.0, -10.0, 0.0, 5.0, -5.0, 20.0, -20.0])


@pytest.fixture(scope="module")
def images(system):
    return images_of(system)


def solver(system, iterations=8, **how):
    return lambda pixels: system.projector.active.compress(
        solvers.nnls(system.projector, pixels, iterations=iterations, **how).volume
    )


def noise_found(system, measured, volume, solving):
    """The noise of images, with what the solve has fitted of known noise made up for."""
    seen = (system.projector @ volume).astype(np.float32)
    noise = noise_of_images(system, measured, seen)
    volume = system.projector.active.expand(volume).reshape(system.projector.grid.shape)
    moved = solve_moved(whole(system, solving), volume, np.zeros_like(measured), noise)
    return noise_of_images(system, measured, seen, moved.remains)


@pytest.mark.parametrize("kind", ["gaussian", "poisson"])
def test_the_noise_is_found_in_the_images(kind):
    system = system_of(5, finer=2)
    images = images_of(system, field=GaussianBlobs((GRID.center,), (2.0,), (1.0,)))
    random = np.random.default_rng(3)
    level = max(image.max() for image in images)
    clean = system.flatten(images)
    if kind == "gaussian":
        measured = system.flatten(noises.gaussian(images, 0.05, random))
        true = np.full(len(clean), 0.05 * level)
    else:
        measured = system.flatten(noises.poisson(images, 200.0, 0.0, random))
        true = np.sqrt(clean * level / 200)
    solving = solver(system, 20)
    found = noise_found(system, measured, solving(measured), solving)
    assert np.linalg.norm(found) == pytest.approx(np.linalg.norm(true), rel=0.15)
    bright = clean > clean.max() / 2
    assert np.linalg.norm(found[bright]) == pytest.approx(np.linalg.norm(true[bright]), rel=0.3)


@pytest.mark.parametrize("cameras", [2, 7])
def test_noise_that_the_solve_fits_is_made_up_for(cameras):
    """Many unknowns and no bounds: up to nearly all of the noise goes into the volume."""
    grid = VoxelGrid((14, 20, 14), 0.8, GRID.center)
    system = system_of(cameras, grid)
    images = images_of(system, grid)
    true = 0.05 * max(image.max() for image in images)
    measured = system.flatten(noises.gaussian(images, 0.05, np.random.default_rng(3)))
    solving = solver(system, 20, nonnegative=False)
    seen = system.projector @ solving(measured)
    left = np.sqrt(np.mean((measured - seen) ** 2))
    found = noise_found(system, measured, solving(measured), solving)
    assert left < 0.9 * true
    assert np.median(found) == pytest.approx(true, rel=0.15)


def test_the_deviations_of_a_linear_solve_are_those_of_its_matrix():
    grid = VoxelGrid((5, 6, 5), 2.0, GRID.center)
    system = system_of(5, grid)
    images = images_of(system, grid)
    columns = np.stack([system.projector @ e for e in np.eye(grid.size, dtype=np.float32)])
    A = columns.T  # (pixels, unknowns)
    step = 1 / np.linalg.norm(A, 2) ** 2
    remaining = np.eye(grid.size) - step * A.T @ A
    inverse = sum(np.linalg.matrix_power(remaining, k) for k in range(4)) @ (step * A.T)

    def landweber(pixels):
        return (inverse @ pixels).astype(np.float32)

    measured = system.flatten(noises.gaussian(images, 0.05, np.random.default_rng(5)))
    seen = (A @ landweber(measured)).astype(np.float32)
    noise = noise_of_images(system, measured, seen)
    found = standard_deviations(system, measured, seen, noise, landweber, repeats=100)
    exact = np.sqrt(inverse**2 @ found.noise**2)  # (unknowns,)
    ratio = found.values / exact
    assert np.median(ratio) == pytest.approx(1, abs=0.05)
    assert np.mean((ratio > 1 / 1.3) & (ratio < 1.3)) > 0.98  # 100 repeats scatter by 7 %


def test_what_non_negativity_holds_at_zero_hardly_deviates(system, images):
    measured = system.flatten(noises.gaussian(images, 0.05, np.random.default_rng(5)))
    found = {}
    for bound in (True, False):
        solving = solver(system, 12, nonnegative=bound)
        volume = solving(measured)
        seen = system.projector @ volume
        noise = noise_of_images(system, measured, seen)
        values = standard_deviations(system, measured, seen, noise, solving, repeats=12).values
        found[bound] = np.linalg.norm(values)
    assert found[True] < 0.8 * found[False]


@pytest.mark.parametrize("repeats", [2, 20])
def test_the_same_seed_gives_the_same_bits(system, images, repeats):
    measured = system.flatten(noises.gaussian(images, 0.05, np.random.default_rng(5)))
    solving = solver(system)
    volume = solvers.nnls(system.projector, measured, iterations=8).volume
    one, two, other = (
        assess(system, measured, volume, solving, repeats=repeats, seed=seed) for seed in (1, 1, 2)
    )
    assert one.standard_deviation.tobytes() == two.standard_deviation.tobytes()
    assert one.standard_deviation.tobytes() != other.standard_deviation.tobytes()


def test_no_noise_is_drawn_twice(system, images):
    """Not for two repeats, nor as a simulation of the same seed drew it."""
    measured = system.flatten(noises.gaussian(images, 0.05, np.random.default_rng(5)))
    solving, asked = solver(system, 4), []

    def watched(pixels):
        asked.append(pixels.astype(np.float64))
        return solving(pixels)

    seen = system.projector @ solving(measured)
    noise = noise_of_images(system, measured, seen)
    standard_deviations(system, measured, seen, noise, watched, repeats=2, seed=5)
    drawn = [np.random.default_rng(5).standard_normal(len(seen))]
    drawn += [pixels - seen for pixels in asked]
    correlation = np.corrcoef(drawn) - np.eye(3)
    correlation[1, 2] = correlation[2, 1] = 0  # both have what is left of the residual
    assert np.abs(correlation).max() < 0.1


def test_half_of_many_repeats_are_around_a_noisy_set_of_the_others(system, images):
    measured = system.flatten(noises.gaussian(images, 0.05, np.random.default_rng(5)))
    solving, asked = solver(system, 4), []

    def watched(pixels):
        asked.append(pixels.astype(np.float64))
        return solving(pixels)

    seen = system.projector @ solving(measured)
    noise = noise_of_images(system, measured, seen)
    found = standard_deviations(system, measured, seen, noise, watched, repeats=20)
    assert len(asked) == 20
    assert found.scatter == 1 / 18**0.5
    first, second = np.array(asked[:10]), np.array(asked[10:])
    drawn = first[0] - seen
    assert np.corrcoef(second.mean(0) - first[1:].mean(0), drawn)[0, 1] > 0.3
    apart = np.concatenate([first - first.mean(0), second - second.mean(0)])
    correlation = np.corrcoef(apart)[:10, 10:]
    assert np.abs(correlation).max() < 0.15  # no noise is drawn twice


def test_views_and_details_of_two_and_of_many_views():
    two = view_coverage(system_of(2), np.ones(GRID.size, np.float32))
    assert two.median_views == 2
    # they face each other: the same line, and layers across it as large as twice the box
    assert two.resolved.worst == pytest.approx(2 * 10, rel=0.1)
    nine = view_coverage(system_of(9), np.ones(GRID.size, np.float32))
    assert nine.median_views == 9
    assert nine.resolved.worst == pytest.approx(2 * 10 * np.sin(np.pi / 18), rel=0.15)
    report = nine.report()["resolved_wavelength"]
    assert 1 <= report["half"] < report["nine_tenths"] < report["worst"]
    assert report["in_words"].startswith("half of all details down to ")


@pytest.mark.parametrize(
    ("views", "coarse"), [(2, True), (3, True), (4, True), (5, False), (6, True), (8, False)]
)
def test_shapes_that_are_a_guess_are_reported_however_many_views_share_a_line(views, coarse):
    """Each camera of an even number in a ring looks along the line of the one opposite."""
    volume = np.ones(GRID.shape, np.float32)
    found = view_coverage(system_of(views), volume.ravel())
    assert found.median_views == views
    assert found.resolved.is_coarse == coarse


def test_details_are_those_of_the_emission_not_of_the_grid():
    system = system_of(5)
    volume = np.zeros(GRID.shape, np.float32)
    volume[3:7, 5:9, 3:7] = 1.0
    small = view_coverage(system, volume.ravel()).resolved
    whole = view_coverage(system, np.ones(GRID.size, np.float32)).resolved
    assert small.worst == pytest.approx(0.4 * whole.worst, rel=0.05)


def test_only_voxels_that_emit_are_judged():
    system = system_of(4)
    volume = np.zeros(GRID.shape, np.float32)
    volume[3:6, 4:9, 3:6] = 1.0
    volume[0, 0, 0] = 0.005
    found = view_coverage(system, volume.ravel())
    assert np.count_nonzero(found.emitting) == 45
    assert found.report()["emitting_by_views"] == {4: 45}
    assert sum(found.report()["by_views"].values()) == GRID.size


def test_the_resolution_follows_the_blur_of_the_solve(system, images):
    measured = system.flatten(images)
    wide = {}
    for iterations in (2, 30):
        solving = solver(system, iterations)
        volume = solving(measured)
        emitting = volume > 0.05 * volume.max()
        found = resolution(system, measured, volume, emitting, solving)
        wide[iterations] = np.median(found.widths)
    assert 1 <= wide[30] < wide[2] < 6


def test_a_dark_scene_is_no_error(system):
    dark = np.zeros(system.projector.shape[0], np.float32)
    found = assess(system, dark, np.zeros(GRID.shape, np.float32), solver(system), repeats=3)
    assert found.standard_deviation is None


def test_one_repeat_has_no_spread(system):
    dark = np.zeros(system.projector.shape[0], np.float32)
    with pytest.raises(ValueError, match="uncertainty: found 1 repeats, expected 0, or 2 or more"):
        assess(system, dark, np.zeros(GRID.shape, np.float32), repeats=1)
