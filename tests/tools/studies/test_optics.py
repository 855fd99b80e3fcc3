"""The study of optics: its forward model against closed forms, the tracer against both."""

from functools import partial

import numpy as np
import pytest
from studies.optics import study
from studies.optics.cases import CASES, LENS, base
from studies.optics.light import Flame, image, line_integrals
from studies.optics.sights import PastRod, Sight
from studies.scenes.forward import radiance
from studies.scenes.media import Gas

import phantoms
from rigs.geometry.image_checks import pixel_centres
from tomo import VoxelGrid

SCALE = 0.25
NOWHERE = np.zeros(2)


@pytest.fixture(scope="module")
def rig():
    return base(SCALE)


@pytest.fixture(scope="module")
def flame(rig):
    return Flame(1, VoxelGrid(rig.volume.shape, rig.volume.spacing))


def test_the_truth_is_the_mean_of_the_field_that_is_seen(flame):
    sampled = phantoms.sample(flame, flame.grid, 16)
    assert np.abs(flame.means - sampled).max() < 2e-3 * sampled.max()
    direct = phantoms.TurbulentFlame(1, flame.grid.extent)
    x, y, z = (axis[[3, 7]] for axis in flame.grid.axes())
    at = np.stack(np.meshgrid(x, y, z), axis=-1)
    np.testing.assert_allclose(flame(at), direct(at), atol=1e-6)  # centres are nodes


@pytest.mark.parametrize("extinction", [0.0, 0.02])
def test_light_is_added_as_the_other_studies_add_it(flame, rig, extinction):
    small = rig[1].scaled(0.5)
    seen = image(Sight(small), flame, extinction)
    expected = radiance(small, flame, Gas(absorption=extinction), supersample=3, step=0.05)
    assert np.abs(seen - expected).max() < 0.01 * expected.max()


@pytest.mark.parametrize("name", ["windows", "mirrors"])
def test_the_tracer_looks_where_the_closed_forms_look(rig, name):
    case = CASES[name](rig)
    for camera, sight in zip(case.modelled, case.sights, strict=True):
        uv = pixel_centres(camera.image_size)
        origins, directions, lengths = sight.pieces(uv, NOWHERE)[-1]
        if not lengths.all():  # the mirror of another camera, behind the flame
            origins, directions, _ = sight.pieces(uv, NOWHERE)[0]
        found, towards = camera.rays(uv)
        np.testing.assert_allclose(towards, directions, atol=1e-12)
        assert np.abs(np.cross(found - origins, directions)).max() < 1e-9


@pytest.mark.parametrize("name", ["rod", "split"])
def test_the_tracer_ends_and_turns_where_the_closed_forms_do(rig, name):
    case = CASES[name](rig)
    for camera, sight in zip(case.modelled, case.sights, strict=True):
        uv = pixel_centres(camera.image_size)
        paths, owners = camera.paths(uv)
        np.testing.assert_array_equal(owners, np.arange(len(uv)))
        for piece, (origins, directions, lengths) in enumerate(sight.pieces(uv, NOWHERE)):
            there = np.flatnonzero(lengths > 0)
            np.testing.assert_array_equal(there, np.flatnonzero(np.diff(paths.ray_ptr) > piece))
            traced = paths.ray_ptr[there] + piece
            np.testing.assert_allclose(paths.origins[traced], origins[there], atol=1e-9)
            np.testing.assert_allclose(paths.directions[traced], directions[there], atol=1e-12)
            np.testing.assert_allclose(paths.lengths[traced], lengths[there], atol=1e-9)


def test_a_mirrored_view_is_the_virtual_cameras_with_left_and_right_exchanged(rig, flame):
    case = CASES["mirrors"](rig)
    sight, direct = next(
        pair for pair in zip(case.sights, case.without, strict=True) if pair[0] != pair[1]
    )
    np.testing.assert_allclose(image(sight, flame)[:, ::-1], image(direct, flame), atol=1e-9)
    case = CASES["split"](rig)
    both, width = image(case.sights[0], flame), case.without[0].camera.image_size[0]
    np.testing.assert_allclose(both[:, :width], image(case.without[0], flame), atol=1e-9)
    np.testing.assert_allclose(both[:, : width - 1 : -1], image(case.without[1], flame), atol=1e-9)


@pytest.mark.parametrize(("depth", "arrives"), [(60.0, 0.0), (-260.0, 1.0)])
def test_a_rod_takes_the_light_from_behind_it_alone(rig, flame, depth, arrives):
    camera, wide = rig[0], 200.0
    point = tuple(flame.grid.center - (depth - wide) * camera.R[2])
    seen = image(PastRod(camera, point, (0.0, 1.0, 0.0), wide), flame)
    np.testing.assert_allclose(seen, arrives * image(Sight(camera), flame), atol=1e-9)


def test_a_lens_sees_a_cone_through_the_point_in_focus(rig):
    sight = CASES["aperture"](rig).sights[3]
    camera, uv = sight.camera, np.array([[3.0, 31.0]])
    depths = {270.0: [], 300.0: [], 330.0: []}
    for _, lens in sight.quadrature():
        ((origins, directions, _),) = sight.pieces(uv, lens)
        for depth, places in depths.items():
            reach = (depth - (origins @ camera.R[2] + camera.t[2])) / (directions @ camera.R[2])
            places.append((origins + reach * directions)[0])
    for depth, places in depths.items():
        places = np.array(places)
        assert len(places) >= 200
        away = np.linalg.norm(places - places.mean(axis=0), axis=1)
        disc = LENS.focal_length / LENS.f_number * abs(depth - 300) / 300
        assert 2 * away.max() == pytest.approx(disc, rel=0.01, abs=1e-9)
        assert np.square(away).mean() == pytest.approx(disc**2 / 8, rel=0.01, abs=1e-9)


def test_even_gas_dims_light_by_its_way_through_the_grid(flame):
    middle, half = np.asarray(flame.grid.center), flame.grid.extent / 2
    origins = np.add(middle, [[0.0, 0.0, -300.0]])
    clear, dim = (
        line_integrals(flame, origins, np.array([[0.0, 0, 1]]), np.array([np.inf]), extinction)
        for extinction in (0.0, 0.01)
    )
    assert np.exp(-0.01 * 2 * half[2]) < dim / clear < 1


def test_a_small_case_is_reconstructed_in_three_ways(monkeypatch, as_given):
    quick = partial(study.reconstructed, method="cgls", iterations=20, **as_given)
    monkeypatch.setattr(study, "reconstructed", quick)
    rows = study.case_rows("rod", 1, SCALE)
    assert [row["way"] for row in rows] == ["without", "modelled", "ignored"]
    (row,) = study.summaries(rows)["nrmse"]
    assert row["without"] < row["modelled"] < row["ignored"]
    assert row["ratio"] == row["modelled"] / row["without"]
    assert row["holds"]
