import dataclasses
import os
import re

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from rigs import Camera, Distortion, Optics, RayTable, Rig, load_rig, look_at, save_rig

LENSES = {
    "none": (),
    "brown": (-0.21, 0.08, 0.001, -0.002, 0.03),
    "tilted": (-0.1, 0.02, 0.001, 0.002, 0, 0, 0, 0, 0.001, 0, 0.001, 0, 0.02, -0.01),
    "fisheye": (0.02, -0.01, 0.003, -0.001),
}


def camera(model="brown", seed=0, size=(160, 120)):
    rng = np.random.default_rng(seed)
    R, t = look_at(rng.normal(size=3) * 300, rng.normal(size=3) * 5, rng.normal(size=3))
    K = [[200.0, 0.3, 82.0], [0.0, 204.0, 57.0], [0.0, 0.0, 1.0]]
    return Camera("cam03", size, K, Distortion(model, LENSES[model]), R, t, status="calibrated")


def in_view(of, count=300, seed=1):
    """Points that a camera sees, with their pixels."""
    rng = np.random.default_rng(seed)
    uv = rng.uniform(0, 1, (count, 2)) * of.image_size - 0.5
    origins, directions = of.rays(uv)
    return uv, origins + directions * rng.uniform(50, 600, (count, 1))


@pytest.mark.parametrize("model", LENSES)
def test_at_pixel_centres_it_is_the_camera_it_was_sampled_from(model):
    true = camera(model)
    table = RayTable.of(true)
    for found, expected in zip(table.rays(), true.rays(), strict=True):
        np.testing.assert_array_equal(found, expected)
    some = np.array([[0, 0], [17, 3], [159, 119]])
    np.testing.assert_allclose(table.rays(some)[1], true.rays(some)[1], rtol=0, atol=1e-15)
    assert table.name == "cam03"
    assert table.image_size == (160, 120)
    assert table.status == "calibrated"


@given(model=st.sampled_from(list(LENSES)), seed=st.integers(0, 999))
@settings(max_examples=12)
def test_it_projects_as_the_camera_does(model, seed):
    true = camera(model, seed)
    table = RayTable.of(true)
    uv, points = in_view(true)
    found, depth, valid = table.project(points)
    assert valid.all()
    np.testing.assert_allclose(found, uv, rtol=0, atol=0.01)
    np.testing.assert_allclose(depth, true.project(points)[1], rtol=0.02)
    directions = table.rays(uv)[1]
    assert np.linalg.norm(directions - true.rays(uv)[1], axis=1).max() < 1e-4
    np.testing.assert_allclose(np.linalg.norm(directions, axis=1), 1, atol=1e-15)
    behind = true.position - (points - true.position)
    assert not table.project(behind)[2].any()
    far_out = points + 1e4 * true.R[0]
    assert not table.project(far_out)[2].any()
    assert not table.project([[np.nan, 0, 0]])[2].any()


def test_bilinear_rays_converge_to_the_cameras_with_the_square_of_the_pixel():
    errors = []
    for factor in (1, 2, 4):
        K = np.diag([factor, factor, 1.0]) @ [[100, 0, 40], [0, 100, 30], [0, 0, 1]]
        lens = Distortion("brown", LENSES["brown"])
        true = Camera("a", (80 * factor, 60 * factor), K, lens)
        uv = np.random.default_rng(0).uniform(0, 59 * factor, (2000, 2))
        off = RayTable.of(true).rays(uv)[1] - true.rays(uv)[1]
        errors.append(np.sqrt(np.mean(off**2)))
    orders = np.log2(np.array(errors[:-1]) / errors[1:])
    np.testing.assert_allclose(orders, 2, atol=0.2)


@pytest.mark.parametrize("model", ["none", "brown"])
def test_it_is_moved_scaled_and_cropped_as_a_camera_is(model):
    true = camera(model)
    table = RayTable.of(true)
    R, _ = look_at([1, 2, 3], [0, 0, 0])
    for change in (
        lambda c: c.transformed(R, [5.0, -3.0, 2.0]),
        lambda c: c.scaled(0.5),
        lambda c: c.scaled(2.0),
        lambda c: c.cropped(10, 20, 90, 70),
        lambda c: c.rotated(90),
        lambda c: c.cropped(10, 20, 90, 70).rotated(270).scaled(0.5),
        lambda c: c.shrunk(3),
        lambda c: c.shifted(2.5, -1.25),
        lambda c: c.cropped(10, 20, 90, 70).scaled(0.5).shifted(1, 0).transformed(R, [0, 0, 1]),
    ):
        expected, found = change(true), change(table)
        assert found.image_size == expected.image_size
        uv, points = in_view(expected)
        # where an image was shifted, its border lies outside the table and is less exact
        inner = (uv > 3).all(axis=1) & (uv < np.array(expected.image_size) - 4).all(axis=1)
        uv, points = uv[inner], points[inner]
        np.testing.assert_allclose(found.rays(uv)[1], expected.rays(uv)[1], rtol=0, atol=2e-4)
        np.testing.assert_allclose(found.project(points)[0], uv, rtol=0, atol=0.01)
        np.testing.assert_allclose(found.position, expected.position, rtol=1e-6)
        np.testing.assert_array_equal(found.inside(uv), expected.inside(uv))


def test_its_nearest_pinhole_is_the_camera_where_that_is_one():
    true = camera("none")
    table = RayTable.of(true)
    np.testing.assert_allclose(table.position, true.position, rtol=1e-9)
    np.testing.assert_allclose(table.R, true.R, atol=1e-9)
    np.testing.assert_allclose(table.t, true.t, atol=1e-6)
    np.testing.assert_allclose(table.camera_matrix, true.camera_matrix, rtol=1e-6, atol=1e-6)
    rigs = Rig((true,)), Rig((table,))
    np.testing.assert_allclose(*(rig.footprint([1, 2, 3]) for rig in rigs), rtol=1e-6)
    assert true.is_pinhole
    assert not table.is_pinhole


def mirrored(true, normal, distance):
    """The table of a camera that looks into the mirror ``normal . x = distance``."""
    origins, directions = true.rays()
    s = (distance - origins @ normal) / (directions @ normal)
    hits = origins + s[:, None] * directions
    turned = directions - 2 * (directions @ normal)[:, None] * normal
    height, width = true.image_size[::-1]
    shape = (height, width, 3)
    return RayTable("mirror", hits.reshape(shape), turned.reshape(shape)), hits, turned


def test_a_mirror():
    K = [[300, 0, 40], [0, 300, 30], [0, 0, 1]]
    true = Camera("a", (80, 60), K, t=[0, 0, 0])  # at the origin, looks along z
    normal = np.array([1.0, 0.0, -1.0]) / np.sqrt(2)
    table, hits, turned = mirrored(true, normal, -100 / np.sqrt(2))
    np.testing.assert_allclose(table.position, [-100, 0, 100], atol=1e-6)  # its mirror image
    rng = np.random.default_rng(0)
    pixels = rng.integers(0, 80 * 60, 200)
    points = hits[pixels] + turned[pixels] * rng.uniform(10, 300, (200, 1))
    found, _, valid = table.project(points)
    assert valid.all()
    expected = np.stack([pixels % 80, pixels // 80], axis=1)
    np.testing.assert_allclose(found, expected, atol=1e-6)
    assert np.linalg.det(table.R) == pytest.approx(1)
    before = hits[pixels] - turned[pixels]  # rays begin at the mirror
    assert not table.project(before)[2].any()


def test_parallel_rays():
    x, y = np.meshgrid(np.arange(40) * 0.5, np.arange(30) * 0.5)
    origins = np.stack([x, y, np.zeros_like(x)], axis=-1)
    table = RayTable("telecentric", origins, np.broadcast_to([0.0, 0.0, 1.0], origins.shape))
    found, _, valid = table.project([[3.25, 7.0, 100.0], [3.25, 7.0, 5.0], [3.25, 7.0, -5.0]])
    np.testing.assert_allclose(found[:2], [[6.5, 14.0]] * 2, atol=1e-9)
    assert valid.tolist() == [True, True, False]
    assert table.position[2] < -1000  # far behind
    np.testing.assert_allclose(table.R[2], [0, 0, 1], atol=1e-9)


def test_pixels_that_see_nothing():
    true = camera("brown")
    directions = RayTable.of(true).directions.copy()
    directions[40:60, 50:90] = np.nan
    directions[:, 0] = np.nan
    table = RayTable("holes", true.position, directions)
    origins, found = table.rays()
    assert np.isfinite(origins).all()
    np.testing.assert_array_equal(np.isnan(found[:, 0]), np.isnan(directions[..., 0]).ravel())
    uv, points = in_view(true, 1000)
    hidden = np.isnan(directions[tuple(np.clip(np.rint(uv).astype(int), 0, [159, 119]).T[::-1])])
    hidden = hidden.any(axis=1)
    pixels, _, valid = table.project(points)
    np.testing.assert_array_equal(valid, ~hidden)
    np.testing.assert_allclose(pixels[valid], uv[valid], atol=0.01)
    # all of a pixel is seen, up to its edge with one that sees nothing
    edge = np.array([[49.49, 50.0], [90.0 - 0.49, 50.0], [0.51, 7.0], [49.51, 50.0]])
    seen = np.isfinite(table.rays(edge)[1]).all(axis=1)
    assert seen.tolist() == [True, True, True, False]
    np.testing.assert_allclose(table.rays(edge[:3])[1], true.rays(edge[:3])[1], atol=1e-4)


def test_two_views_in_one_image():
    left = camera("none", 3, (80, 60))
    right = left.transformed(look_at([300, 40, 0], [0, 0, 0])[0], [9.0, 0, 5.0])
    directions = np.concatenate([RayTable.of(c).directions for c in (left, right)], axis=1)
    directions[:, 80] = np.nan
    origins = np.repeat([left.position, right.position], 80, axis=0)
    table = RayTable("split", np.broadcast_to(origins, (60, 160, 3)), directions)
    for half, at in ((left, 0), (right, 80)):
        uv, points = in_view(half, 200)
        kept = uv[:, 0] > 1
        found, _, valid = table.project(points[kept])
        is_near = np.abs(found - (uv[kept] + [at, 0])).max(axis=1) < 0.01
        other = right if half is left else left
        twice = other.inside(np.nan_to_num(other.project(points[kept])[0], nan=-9))
        assert valid.all()
        assert (is_near | twice).all()
        assert is_near.mean() > 0.5


def test_it_is_a_value():
    table = RayTable.of(camera())
    again = RayTable("cam03", table.origins, table.directions, status="calibrated")
    assert table == again
    assert hash(table) == hash(again)
    assert table != dataclasses.replace(table, offset=(1.0, 0.0))
    assert table != camera()
    assert "160 x 120" in repr(table)
    with pytest.raises(ValueError, match="read-only"):
        table.directions[0, 0, 0] = 1


def test_rigs_with_tables_come_back_bit_by_bit(tmp_path):
    true = camera("fisheye")
    window = RayTable(
        "window",
        np.random.default_rng(0).normal(size=(20, 30, 3)),
        np.random.default_rng(1).normal(size=(20, 30, 3)),
        optics=Optics(f_number=4.0),
        status="calibrated",
    )
    central = dataclasses.replace(RayTable.of(true), name="central").scaled(0.5).shifted(1, 2)
    rig = Rig((true, window, central), "mm", "up is y")
    save_rig(rig, tmp_path / "rig.yaml")
    assert load_rig(tmp_path / "rig.yaml") == rig
    assert sorted(os.listdir(tmp_path)) == [
        "rig.yaml",
        "rig_rays_central.npz",
        "rig_rays_window.npz",
    ]
    save_rig(rig.without("central"), tmp_path / "other.yaml")  # does not touch the first's tables
    assert load_rig(tmp_path / "rig.yaml") == rig


GOOD = {"origins": np.zeros(3), "directions": np.ones((4, 5, 3))}


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"directions": np.zeros((4, 5, 3))}, "directions: found a zero vector"),
        ({"directions": np.ones((4, 5))}, "directions: found shape (4, 5), expected"),
        ({"directions": "x"}, "directions: found str, expected numbers"),
        ({"origins": [0, 0]}, "origins: found shape (2,), expected (height, width, 3)"),
        ({"origins": [0, 0, np.nan]}, "origins: found NaN or infinity"),
        ({"scale": -1}, "scale: found -1.0"),
        ({"offset": (0, np.inf)}, "offset: found NaN or infinity"),
        ({"image_size": (0, 3)}, "image_size: found (0, 3)"),
        ({"status": "fine"}, "status: found 'fine'"),
        ({"optics": 3}, "optics: found 3"),
    ],
)
def test_bad_values_are_refused(change, message):
    with pytest.raises(ValueError, match=re.escape(f"camera a: {message}")):
        RayTable(**({"name": "a"} | GOOD | change))
