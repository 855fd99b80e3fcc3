import pytest

from rigs import ring
from tomo.grid import VoxelGrid
from tomo.operators import LinearSystem
from tomo.operators.timing import estimate_effort

GRID = VoxelGrid((20, 30, 20), 1.0)
RIG = ring(4, distance=400.0, image_size=(60, 80), footprint=0.5, pitch_degrees=5.0)


def test_counts_are_those_of_the_system_and_times_are_for_all_of_it():
    effort = estimate_effort(RIG, GRID)
    system = LinearSystem.from_rig(RIG, GRID)
    assert effort.form == system.form == "stored"
    assert effort.need.segments == pytest.approx(system.projector.n_segments, rel=0.05)
    assert effort.need.rays == pytest.approx(sum(map(len, system.pixels)), rel=0.05)
    assert 0 < effort.iteration_seconds < 20
    assert 0 < effort.trace_seconds < 20


def test_where_the_matrix_does_not_fit_the_other_form_is_timed():
    need = estimate_effort(RIG, GRID).need
    small = estimate_effort(RIG, GRID, available=need.nbytes // 2)
    assert small.form == "on-the-fly"
    assert small.need.nbytes < need.nbytes
    assert small.iteration_seconds > 0


def test_a_volume_of_a_few_pixels_is_found_by_the_sample():
    rig = ring(2, distance=400.0, image_size=(400, 400), footprint=1.0)
    effort = estimate_effort(rig, VoxelGrid((6, 6, 6), 1.0, (40.3, 30.2, 20.1)))
    assert 0 < effort.need.rays < 200
    assert effort.iteration_seconds > 0
