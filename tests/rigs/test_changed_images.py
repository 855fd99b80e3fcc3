"""Cropped, turned, resized and renamed cameras see what the changed images show."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from rigs import Camera, Distortion, Optics, RayTable, Rig
from rigs.changes import ImageChange, with_cameras, with_images_changed

# how large each coefficient may get, in OpenCV's order: stronger than a lens is
LARGEST = (0.3, 0.1, 0.02, 0.02, 0.05, 0.3, 0.1, 0.05, 0.02, 0.02, 0.02, 0.02, 0.2, 0.2)
COUNTS = {"none": 0, "brown": 5, "rational": 8, "thin_prism": 12, "tilted": 14, "fisheye": 4}
MODELS = tuple(COUNTS)
SEEN = 3000.0  # pixels; farther out the last bits of a coordinate are 1e-12 of it and more
CLOSE = 1e-9  # pixels


def random_camera(model, rng):
    lens = Distortion(model, rng.uniform(-1, 1, COUNTS[model]) * LARGEST[: COUNTS[model]])
    R = Rotation.random(random_state=rng).as_matrix()
    K = [[1200.0, 0.0, 650.0], [0.0, 1210.0, 470.0], [0.0, 0.0, 1.0]]
    return Camera("c", (1280, 960), K, lens, R, rng.normal(size=3) * 5)


def points_before(camera, rng):
    """Points in front of the camera, up to about 60 degrees off its axis."""
    in_camera = rng.uniform([-1.5, -1.5, 1], [1.5, 1.5, 5], (200, 3))
    return (in_camera - camera.t) @ camera.R


def on_changed_image(uv, size, change):
    """The same change of pixels, by its definition: windows, columns and rows, edges of pixels."""
    u, v = uv.T
    width, height = size
    if change.crop is not None:
        x, y, width, height = change.crop
        u, v = u - x, v - y
    for _ in range(change.degrees // 90):
        u, v, width, height = height - 1 - v, u, height, width
    return np.stack([(u + 0.5) / change.scale - 0.5, (v + 0.5) / change.scale - 0.5], axis=-1)


@st.composite
def image_changes(draw):
    x, y = draw(st.integers(0, 1000)), draw(st.integers(0, 700))
    window = (x, y, draw(st.integers(40, 1280 - x)), draw(st.integers(40, 960 - y)))
    crop = draw(st.sampled_from([None, window]))
    scales = st.one_of(st.integers(1, 8).map(float), st.floats(0.2, 10))
    return ImageChange(crop, draw(st.sampled_from([0, 90, 180, 270])), draw(scales))


@pytest.mark.parametrize("model", MODELS)
@settings(max_examples=8)
@given(skew=st.sampled_from([0.0, 25.0]), seed=st.integers(0, 2**32 - 1), change=image_changes())
def test_points_are_projected_where_the_changed_image_shows_them(model, skew, seed, change):
    rng = np.random.default_rng(seed)
    camera = random_camera(model, rng)
    K = np.array(camera.camera_matrix)
    K[0, 1] = skew
    camera = replace(camera, camera_matrix=K)
    points = points_before(camera, rng)
    uv, depth, valid = camera.project(points)
    near = valid & (np.abs(np.nan_to_num(uv)) < SEEN).all(axis=1)
    changed = change.of(camera)
    found, found_depth, still_valid = changed.project(points)
    expected = on_changed_image(uv, camera.image_size, change)
    # next to a fold, which is looked for along a set of directions, one of both may be out
    both = near & still_valid
    assert both.sum() >= 0.98 * near.sum() - 1
    growth = max(1.0, 1 / change.scale)
    np.testing.assert_allclose(found[both], expected[both], rtol=0, atol=CLOSE * growth)
    np.testing.assert_allclose(found_depth, depth, rtol=0, atol=1e-10)
    assert changed.distortion.model == model
    assert changed.camera_matrix[1, 0] == 0


@pytest.mark.parametrize("kind", ["camera", "table", "table of many origins"])
@pytest.mark.parametrize("model", MODELS)
@pytest.mark.parametrize("degrees", [90, 180, 270])
def test_rays_of_a_turned_image_are_turned_like_its_pixels(kind, model, degrees):
    rng = np.random.default_rng(degrees)
    lens = replace(random_camera(model, rng), image_size=(50, 34))
    K = [[60.0, 2.0, 23.0], [0, 62.0, 19.0], [0, 0, 1]]
    camera = replace(lens, camera_matrix=K)
    if kind != "camera":
        camera = RayTable.of(camera).cropped(3, 2, 40, 30).scaled(0.5)
    if kind == "table of many origins":
        origins = camera.origins + rng.normal(size=camera.origins.shape)
        camera = replace(camera, origins=origins)
    width, height = camera.image_size
    turned = camera.rotated(degrees)
    assert turned.image_size == ((width, height) if degrees == 180 else (height, width))
    for before, after in zip(camera.rays(), turned.rays(), strict=True):
        image = np.rot90(before.reshape(height, width, 3), -(degrees // 90))
        np.testing.assert_allclose(after, image.reshape(-1, 3), rtol=0, atol=1e-12)
    again = turned.rotated(360 - degrees)
    assert again.image_size == camera.image_size
    uv = rng.uniform(0, [width - 1, height - 1], (50, 2))
    for before, after in zip(camera.rays(uv), again.rays(uv), strict=True):
        np.testing.assert_allclose(after, before, rtol=0, atol=1e-12)


@settings(max_examples=6)
@given(
    degrees=st.sampled_from([0, 90, 180, 270]),
    scale=st.sampled_from([0.5, 1.0, 2.0, 3.0]),
    window=st.tuples(st.integers(0, 20), st.integers(0, 10)),
)
def test_tables_project_where_the_changed_image_shows_points(degrees, scale, window):
    lens = Distortion("brown", (-0.2, 0.05, 0.01, -0.02))
    camera = Camera("a", (64, 48), [[80, 0, 32], [0, 80, 24], [0, 0, 1]], lens, t=[0, 0, 100.0])
    table = RayTable.of(camera)
    points = np.random.default_rng(0).uniform(-20, 20, (40, 3))
    uv, _, seen = table.project(points)
    change = ImageChange((*window, 42, 36), degrees, scale)
    found, _, still_seen = change.of(table).project(points)
    np.testing.assert_array_equal(still_seen, seen)
    expected = on_changed_image(uv, table.image_size, change)
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-8)  # Newton's steps end at 1e-9


def test_only_right_angles_are_turned_by():
    camera = Camera("a", (4, 3), np.eye(3))
    for one in (camera, RayTable.of(camera)):
        with pytest.raises(
            ValueError, match="camera a: rotate: found 45, expected 90, 180 or 270"
        ):
            one.rotated(45)


def test_a_plain_lens_stays_plain_to_the_last_bit():
    camera = Camera("a", (640, 480), [[800, 0, 320], [0, 810, 240], [0, 0, 1]], t=[1, 2, 3.0])
    turned = camera.rotated(90)
    assert turned.camera_matrix.tolist() == [[810, 0, 239], [0, 800, 320], [0, 0, 1]]
    assert turned.R.tolist() == [[0, -1, 0], [1, 0, 0], [0, 0, 1]]
    assert turned.t.tolist() == [-2, 1, 3]
    assert turned.distortion == camera.distortion


def test_pixels_of_a_shrunken_image_are_farther_apart():
    optics = Optics(focal_length=25.0, pixel_pitch=0.005)
    camera = Camera("a", (64, 48), np.eye(3), optics=optics)
    for one in (camera, RayTable.of(camera)):
        assert one.shrunk(2).optics == Optics(focal_length=25.0, pixel_pitch=0.01)
        assert one.scaled(2.0).optics.pixel_pitch == 0.0025
    assert replace(camera, optics=None).shrunk(2).optics is None


def record(held="b"):
    corners = [[0.0, 0, 80], [10, 0, 80], [10, 10, 80], [0, 10, 80]]
    return {
        "rms_px": 0.1,
        "held": held,
        "cameras": {name: {"rms_px": i} for i, name in enumerate("abc")},
        "findings": ["camera b: something"],
        "target_poses": [{"frame": "f0", "camera": held, "corners": corners}],
    }


@pytest.fixture
def rig():
    rng = np.random.default_rng(1)
    cameras = [replace(random_camera("brown", rng), name=name) for name in "abc"]
    return Rig(tuple(cameras), calibration=record())


def corners_in_the_world(rig):
    (pose,) = rig.calibration["target_poses"]
    camera = rig[pose["camera"]]
    return (np.array(pose["corners"]) - camera.t) @ camera.R


def test_a_change_is_of_the_cameras_named(rig):
    changed = with_images_changed(rig, {"b": ImageChange((0, 0, 100, 50), 90, 2.0)})
    assert (changed[0], changed[2]) == (rig[0], rig[2])
    assert changed["b"] == rig["b"].cropped(0, 0, 100, 50).rotated(90).shrunk(2)
    with pytest.raises(ValueError, match="camera d: not in the rig, expected one of a, b, c"):
        with_images_changed(rig, {"d": ImageChange()})
    with pytest.raises(ValueError, match="camera a: scale: found -1"):
        with_images_changed(rig, {"a": ImageChange(scale=-1)})


def test_new_names_are_given_at_once(rig):
    swapped = with_cameras(rig, {"a": "b", "b": "a", "c": "c"})
    assert swapped.names == ("b", "a", "c")
    assert swapped["b"] == replace(rig["a"], name="b")
    assert with_cameras(rig, {"c": "c", "a": "x"}).names == ("x", "c")
    with pytest.raises(ValueError, match="camera c: name: found twice"):
        with_cameras(rig, {"a": "c", "c": "c"})
    with pytest.raises(ValueError, match="camera d: not in the rig"):
        with_cameras(rig, {"d": "a"})


def test_calibration_figures_follow_their_cameras(rig):
    changed = with_cameras(rig, {"a": "b", "b": "left"}).calibration
    assert changed["cameras"] == {"b": {"rms_px": 0}, "left": {"rms_px": 1}}
    assert changed["held"] == changed["target_poses"][0]["camera"] == "left"
    assert changed["rms_px"] == 0.1
    assert changed["changed_since"] == ["a: renamed b", "b: renamed left", "left out: c"]
    assert rig.calibration == record()


def test_poses_of_targets_stay_where_they_were(rig):
    expected = corners_in_the_world(rig)
    turned = with_images_changed(rig, {"b": ImageChange(None, 90)})
    assert turned.calibration["changed_since"] == ["b: images rotated by 90 degrees clockwise"]
    without = with_cameras(rig, {"a": "a", "c": "c"})
    assert without.calibration["target_poses"][0]["camera"] == "a"
    for changed in (turned, without):
        np.testing.assert_allclose(corners_in_the_world(changed), expected, atol=1e-3)


@pytest.mark.parametrize(
    "odd",
    [
        {"target_poses": "x", "held": 3, "cameras": ["a"], "changed_since": "x"},
        {"target_poses": [3, {"camera": "b"}, {"camera": "b", "corners": [1]}]},
        {"target_poses": [{"camera": [], "corners": "x"}, {"camera": "b", "corners": "x"}]},
        {"cameras": {"a": {}, "other": {}}},
    ],
)
def test_a_calibration_of_any_other_form_is_kept(rig, odd):
    rig = replace(rig, calibration=odd)
    changed = with_cameras(rig, {"a": "x", "c": "c"}).calibration
    for key, value in odd.items():
        if key != "changed_since":
            assert changed[key] == value
