"""Whether the default's faint penalty stays, and on which basis: errors foretold, and gaps."""

import numpy as np
import pytest

import phantoms
import rigs
from tomo.grid import VoxelGrid
from tomo.operators import LinearSystem, Projector
from tomo.rays import Rays
from tomo.selection import Choice, candidates, choose_by_held_out_views, rules
from tomo.selection.choose import solve_as_chosen
from tomo.simulation import simulate_images
from tomo.trace import trace


@pytest.fixture(scope="module")
def resolving():
    """Return sixteen cameras with two pixels to a voxel."""
    rig = rigs.ring(16, distance=300.0, image_size=(44, 60), footprint=0.5)
    return LinearSystem.from_rig(rig, VoxelGrid((14, 24, 14), 1.0)).projector


@pytest.fixture(scope="module")
def apart():
    """Return nine lines along z that pass over two columns of voxels."""
    grid = VoxelGrid((6, 5, 4), 1.0)
    points = np.meshgrid([-2.5, -1.5, 1.5], [-2.0, -1.0, 0.0], [-9.0])
    rays = Rays.from_lines(np.stack(points, -1).reshape(-1, 3), [0, 0, 1])
    return Projector(trace(rays, grid), grid)


class Foreseen:
    """Candidates whose squared errors are foreseen beforehand, by method, width and iterations."""

    def __init__(self, plain, penalised):
        self.plain, self.penalised, self.tried = plain, penalised, []

    def smoothed(self, method, widths):
        assert method == "nnls"
        return [candidates.Fit(method, *each, 0.0, each[2:]) for each in self.plain]

    def fit(self, method, width, best=(), *, iterations, to_the_end=False):
        self.tried.append((method, width, iterations, to_the_end))
        error = self.penalised[width, iterations]
        return candidates.Fit(method, width, iterations, error, 0.0, [error])

    def candidate(self, found):
        return found.method, found.width, found.iterations, found.error


@pytest.mark.parametrize(
    ("narrower", "penalised", "with_penalty", "asked_for", "taken"),
    [
        (1.2, 1.1, 0.93, True, (0.5, 30)),
        (1.2, 1.1, 0.95, True, (0.8, 20)),
        (1.3, 1.1, 0.5, False, (0.8, 20)),  # far worse without the penalty
        (1.2, 1.05, 0.5, False, (0.8, 20)),  # images without detail
    ],
)
def test_a_narrower_basis_is_taken_where_the_penalty_makes_it_clearly_better(
    narrower, penalised, with_penalty, asked_for, taken, resolving
):
    plain = [(0.0, 17, 2.0), (0.5, 17, narrower), (0.8, 20, 1.0)]
    foreseen = Foreseen(plain, {(0.8, 20): penalised, (0.8, 30): 1.0, (0.5, 30): with_penalty})
    best = rules.of_many_views(foreseen, resolving)
    assert (best.method, best.width, best.iterations) == ("tikhonov", *taken)
    longer = [each for each in foreseen.tried if each[-1] is True]
    asked = [("tikhonov", 0.8, 30, True), ("tikhonov", 0.5, 30, True)]
    assert longer == (asked if asked_for else [])


@pytest.mark.parametrize("width", [0.0, 0.5])
@pytest.mark.parametrize(("share", "left_out"), [(0.69, True), (0.71, False)])
def test_the_penalty_is_left_out_where_left_out_views_speak_clearly_against_it(
    width, share, left_out, resolving, apart
):
    for projector in (resolving, apart):
        foreseen = Foreseen([(width, 20, share)], {(width, 20): 1.0})
        best = rules.of_many_views(foreseen, projector)
        tame = projector is apart or not left_out
        assert best.method == ("tikhonov" if tame else "nnls")
        assert (best.width, best.iterations) == (width, 20)


def test_where_rays_leave_gaps_the_volume_stays_tame():
    grid = VoxelGrid((18, 28, 18), 1.0)
    rig = rigs.ring(12, distance=300.0, image_size=(20, 24), footprint=1.5)
    field = phantoms.create("jet", seed=1, extent=grid.extent)
    scan = simulate_images(rig, field, grid, supersample=3, refine=2)
    system = LinearSystem.from_rig(rig, grid)
    images = system.flatten(list(scan.images.values()))
    choice = choose_by_held_out_views(system.projector, images)
    alike = ("nnls", choice.width, choice.iterations)
    plain = next(Choice(*each) for each in choice.tried if each[:3] == alike)
    assert choice.method == "tikhonov"
    assert plain.held_out_residual < 0.8 * choice.held_out_residual
    tame, wild = (
        np.linalg.norm(solve_as_chosen(system.projector, images, one).volume - scan.truth)
        for one in (choice, plain)
    )
    assert tame < 0.8 * wild


def test_gaps_are_between_rays_and_not_beside_them(resolving, apart):
    # Of six columns along x two are passed over; the sixth, and two of five along y, lie beside.
    assert rules._fraction_in_gaps(apart) == 2 * 3 * 4 / apart.grid.size
    assert rules._fraction_in_gaps(resolving) == 0
