import re

import pytest

from rigs import ring
from tomo import LinearSystem, VoxelGrid
from tomo.operators import BYTES_PER_VOXEL, choose_form, estimate_memory

GRID = VoxelGrid((12, 30, 12), 0.7, (1.0, 2.0, 3.0))
RIG = ring(
    5, distance=150.0, image_size=(48, 64), footprint=0.5, center=GRID.center, pitch_degrees=20.0
)


@pytest.mark.parametrize("supersample", [1, 2])
def test_the_estimate_is_close_to_what_tracing_finds(supersample):
    need = estimate_memory(tuple(RIG), GRID, supersample=supersample)
    system = LinearSystem.from_rig(RIG, GRID, supersample=supersample)
    assert need.segments == pytest.approx(len(system.projector.segments), rel=0.02)
    assert need.rays == pytest.approx(system.projector.shape[0] * supersample**2, rel=0.05)
    assert need.voxels == GRID.size
    assert need.nbytes >= system.projector.segments.nbytes


@pytest.mark.parametrize("share", [0.9, 0.5, 0.1, 0.02])
@pytest.mark.parametrize("refinement", [1, 10])
def test_the_grid_said_to_fit_fits(share, refinement):
    grid = GRID.refined(refinement)  # crossings weigh most, then voxels
    cameras = tuple(RIG)
    need = estimate_memory(cameras, grid)
    available = int(share * need.nbytes)
    choose_form(cameras, grid, wanted="stored", available=need.nbytes)
    with pytest.raises(ValueError, match="would take about") as caught:
        choose_form(cameras, grid, wanted="stored", available=available)
    message = str(caught.value)
    assert "\n" not in message
    assert message.startswith(f"grid {'x'.join(map(str, grid.shape))}: would take about")
    advice = re.search(r"(\d+)x(\d+)x(\d+) voxels of (\S+) x (\S+) x (\S+) would fit", message)
    if advice is None:
        assert "no grid would fit: use smaller images" in message
        floor = estimate_memory(cameras, VoxelGrid((1, 1, 1), tuple(grid.extent), grid.center))
        assert floor.nbytes > 0.7 * available
        return
    shape = tuple(int(n) for n in advice.groups()[:3])
    fits = VoxelGrid.from_bounds(shape, grid.lower, grid.upper)
    assert [float(s) for s in advice.groups()[3:]] == pytest.approx(fits.spacing, rel=1e-3)
    choose_form(cameras, fits, wanted="stored", available=available)
    needed = estimate_memory(cameras, fits).nbytes
    # nor is the advice needlessly coarse: rounding down costs small grids most
    finer = VoxelGrid.from_bounds(tuple(n + 1 for n in shape), grid.lower, grid.upper)
    assert estimate_memory(cameras, finer).nbytes > 0.6 * available >= 0.6 * needed


def test_voxels_beyond_any_memory_are_counted_without_overflow():
    grid = VoxelGrid((999_999_999,) * 3, 1e-8, GRID.center)
    need = estimate_memory(tuple(RIG), grid)
    assert need.nbytes == pytest.approx(BYTES_PER_VOXEL * 1e27, rel=1e-6)
    with pytest.raises(ValueError, match="would fit"):
        choose_form(tuple(RIG), grid, wanted="stored")


def test_the_matrix_is_stored_where_it_fits_and_computed_on_the_fly_where_not():
    cameras, grid = tuple(RIG), GRID.refined(4)
    stored = estimate_memory(cameras, grid).nbytes
    flying = estimate_memory(cameras, grid, form="on-the-fly").nbytes
    assert flying < stored
    assert choose_form(cameras, grid, available=stored)[0] == "stored"
    # no count of crossings is needed where even the most that there can be would fit
    form, reason = choose_form(cameras, grid, available=10**13)
    assert form == "stored"
    assert "takes at most" in reason
    form, reason = choose_form(cameras, grid, available=stored - 1)
    assert form == "on-the-fly"
    assert "the matrix takes about" in reason
    with pytest.raises(ValueError, match="would take about"):
        choose_form(cameras, grid, available=flying - 1)


def test_what_is_asked_for_is_given_or_refused():
    cameras, enough = tuple(RIG), 10**12
    assert choose_form(cameras, GRID, wanted="on-the-fly", available=enough)[0] == "on-the-fly"
    assert choose_form(cameras, GRID, wanted="stored", available=enough)[0] == "stored"
    with pytest.raises(ValueError, match="needs the matrix entries"):
        choose_form(cameras, GRID, wanted="on-the-fly", needs_matrix=True, available=enough)
    with pytest.raises(ValueError, match="projector: found 'fast', expected one of auto, stored"):
        choose_form(cameras, GRID, wanted="fast", available=enough)
    with pytest.raises(ValueError, match="would take about"):
        choose_form(cameras, GRID, needs_matrix=True, available=1000)


@pytest.mark.parametrize("size", [(500, 500), (1000, 300), (640, 480), (401, 377), (2000, 50)])
def test_the_sample_of_rays_does_not_fall_into_step_with_the_image(size):
    rig = ring(1, distance=150.0, image_size=size, footprint=0.06, center=GRID.center)
    system = LinearSystem.from_rig(rig, GRID)
    need = estimate_memory(tuple(rig), GRID)
    assert need.rays == pytest.approx(system.projector.shape[0], rel=0.1)
    assert need.segments == pytest.approx(system.projector.n_segments, rel=0.1)
