import cv2
import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

import rigs
from rigs import Camera, Distortion, Optics, look_at

SIZES = {"brown": 5, "rational": 8, "thin_prism": 12, "tilted": 14, "fisheye": 4}
# How large each coefficient may get: far stronger than any real lens, folds included.
LARGEST = np.array([0.4, 0.3, 0.02, 0.02, 0.1, 0.3, 0.2, 0.1, 0.02, 0.02, 0.02, 0.02, 0.2, 0.2])
K = np.array([[1200.0, 0.0, 640.0], [0.0, 1210.0, 480.0], [0.0, 0.0, 1.0]])
MODELS = pytest.mark.parametrize("model", [*SIZES, "none"])
SEEDS = given(seed=st.integers(0, 2**32 - 1))


def random_lens(model, rng):
    if model == "none":
        return Distortion()
    largest = LARGEST[: SIZES[model]] if model != "fisheye" else np.full(4, 0.2)
    return Distortion(model, tuple(rng.uniform(-1, 1, len(largest)) * largest))


def random_rotation(rng):
    return cv2.Rodrigues(rng.normal(size=3) * 2)[0]


def random_camera(model, rng, distance=5.0):
    R = random_rotation(rng)
    return Camera("c", (1280, 960), K, random_lens(model, rng), R, rng.normal(size=3) * distance)


def points_before(camera, rng, count=200):
    """Points in front of the camera, up to about 80 degrees off its axis."""
    in_camera = rng.normal(size=(count, 3)) * [1.5, 1.5, 0.3] + [0, 0, 1.5]
    in_camera[:, 2] = np.abs(in_camera[:, 2]) + 0.1
    return (in_camera - camera.t) @ camera.R


@MODELS
@SEEDS
@settings(max_examples=10)
def test_rays_invert_project(model, seed):
    rng = np.random.default_rng(seed)
    camera = random_camera(model, rng)
    points = points_before(camera, rng)
    uv, _, valid = camera.project(points)
    # Next to a pole, or far out on a high power of the radius, the last bits of a world point
    # are more than 1e-9 px. Leave out where 1e-6 moves the image by more than 0.01 px, which is
    # eight times what it does in the middle.
    nudged, _, nudged_valid = camera.project(points + 1e-6 * camera.R[0])
    with np.errstate(invalid="ignore"):
        near = valid & nudged_valid & (np.linalg.norm(nudged - uv, axis=1) < 0.01)
    assert near.sum() >= 0.1 * valid.sum()
    origins, directions = camera.rays(uv[near])
    seen = points[near] - origins
    seen /= np.linalg.norm(seen, axis=1, keepdims=True)
    again, _, still_valid = camera.project(origins + 3 * directions)
    assert still_valid.all()
    assert np.abs(again - uv[near]).max(initial=0) < 1e-9
    # The same direction, not another one beyond a fold; near folds the inverse is steep.
    assert np.abs(directions - seen).max(initial=0) < 1e-6
    assert np.abs(np.linalg.norm(directions, axis=1) - 1).max(initial=0) < 1e-12


@MODELS
@SEEDS
@settings(max_examples=5)
def test_every_pixel_has_a_ray_that_hits_it_or_none_does(model, seed):
    rng = np.random.default_rng(seed)
    camera = random_camera(model, rng)
    uv = rng.uniform([-200, -200], [1480, 1160], (300, 2))
    origins, directions = camera.rays(uv)
    seen = np.isfinite(directions).all(axis=1)
    again, _, valid = camera.project((origins + directions)[seen])
    assert valid.all()
    assert np.abs(again - uv[seen]).max(initial=0) < 1e-9
    assert np.isnan(directions[~seen]).all()
    # Pixels without a ray have no preimage: no direction of a dense fan projects near them.
    fan = points_before(camera, rng, 20000)
    reached, _, in_domain = camera.project(fan)
    missed = uv[~seen]
    if len(missed) and in_domain.any():
        reached = reached[in_domain]
        lonely = [np.linalg.norm(reached - pixel, axis=1).min() for pixel in missed[:20]]
        crowd = [np.linalg.norm(reached - pixel, axis=1).min() for pixel in again[:20]]
        if crowd:
            assert np.median(lonely) > np.median(crowd)


@pytest.mark.parametrize("model", SIZES)
@SEEDS
@settings(max_examples=10)
def test_projection_is_opencvs(model, seed):
    rng = np.random.default_rng(seed)
    camera = random_camera(model, rng)
    points = points_before(camera, rng)
    uv, depth, valid = camera.project(points)
    assume(valid.any())
    assert (depth > 0).all()
    module = cv2.fisheye if model == "fisheye" else cv2
    coefficients = np.array(camera.distortion.coefficients)
    rotation_vector = cv2.Rodrigues(camera.R)[0]
    arguments = (rotation_vector, camera.t.copy(), K, coefficients)
    expected = module.projectPoints(points[valid][:, None], *arguments)[0][:, 0]
    np.testing.assert_allclose(uv[valid], expected, rtol=1e-8, atol=1e-6)


def test_a_fold_is_where_theory_puts_it():
    # x (1 + k r²) turns back at r = 1 / sqrt(-3 k)
    k = -0.3
    fold = 1 / np.sqrt(-3 * k)
    camera = Camera("c", (1280, 960), K, Distortion("brown", (k, 0, 0, 0)))
    radii = fold * np.array([0.5, 1 - 1e-9, 1 + 1e-9, 1.2, 3.0])
    points = np.stack([radii, 0 * radii, 1 + 0 * radii], axis=-1)
    uv, _, valid = camera.project(points)
    assert valid.tolist() == [True, True, False, False, False]
    assert np.isnan(uv[2:]).all()
    farthest = 640 + 1200 * fold * (1 + k * fold**2)
    _, directions = camera.rays([[farthest - 1e-3, 480], [farthest + 1e-3, 480]])
    assert np.isfinite(directions).all(axis=1).tolist() == [True, False]


def test_beyond_a_fold_that_turns_back_again_nothing_is_valid():
    # The determinant is positive again at large radii: only the path to them shows it.
    lens = Distortion("brown", (-1.2, 0.5, 0, 0))
    radii = np.linspace(0.01, 3, 300)
    points = np.stack([radii, 0 * radii, 1 + 0 * radii], axis=-1)
    image, valid = lens.project(points)
    slope = 1 - 3.6 * radii**2 + 2.5 * radii**4
    fold = radii[slope < 0][0]
    assert slope[-1] > 0
    assert (valid == (radii < fold)).all()
    assert (np.diff(image[valid, 0]) > 0).all()


WRAPS = {  # several directions a pixel, without a fold that a determinant or a ladder shows
    "prism": Distortion(
        "thin_prism",
        (0.139, -0.0036, -0.266, -0.05, 0, -0.0026, 0, 0.002, -0.0067, 0, -0.03, 0.87),
    ),
    "tangential, near the axis": Distortion("brown", (0, 0, 1e3, 0)),
    "radial, near the axis": Distortion("brown", (-1e9, 4e17, 0, 0)),
}


@pytest.mark.parametrize("lens", WRAPS.values(), ids=WRAPS.keys())
def test_two_directions_never_share_a_pixel(lens):
    random = np.random.default_rng(0)
    radius = np.tan(1.5 * random.random(20_000)) * 10.0 ** random.uniform(-8, 0, 20_000)
    turn = random.uniform(0, 2 * np.pi, 20_000)
    points = np.stack([radius * np.cos(turn), radius * np.sin(turn), np.ones(20_000)], axis=-1)
    image, valid = lens.project(points)
    assert valid.sum() > 1000
    seen = lens.unproject(image[valid])
    seen = seen[:, :2] / seen[:, 2:]
    assert np.abs(seen - points[valid, :2]).max() < 1e-6


def test_fisheye_sees_beyond_a_right_angle():
    camera = Camera(
        "c", (1280, 960), K * 0.2 + 0.8 * np.diag([0, 0, 1]), Distortion("fisheye", (0,) * 4)
    )
    angles = np.deg2rad([0.0, 45, 89, 90, 91, 135])
    points = np.stack([np.sin(angles), 0 * angles, np.cos(angles)], axis=-1)
    uv, depth, valid = camera.project(points)
    assert valid.all()
    assert depth[-1] < 0
    np.testing.assert_allclose(uv[:, 0], 128 + 240 * angles, atol=1e-9)  # equidistant
    np.testing.assert_allclose(camera.rays(uv)[1], points, atol=1e-12)


def test_nothing_behind_a_camera_is_valid():
    camera = Camera("c", (8, 8), K)
    points = [[0, 0, -1], [0, 0, 0], [1, 0, 0], [np.nan, 0, 1], [np.inf, 0, 1], [0, 0, 1]]
    uv, _, valid = camera.project(points)
    assert valid.tolist() == [False] * 5 + [True]
    assert np.isnan(uv[:5]).all()


@MODELS
@SEEDS
@settings(max_examples=5)
def test_a_rigid_motion_of_everything_changes_no_image(model, seed):
    rng = np.random.default_rng(seed)
    camera = random_camera(model, rng)
    points = points_before(camera, rng, 50)
    R, t = random_rotation(rng), rng.normal(size=3) * 10
    uv, depth, valid = camera.project(points)
    steady = valid & (np.abs(np.nan_to_num(uv)).max(axis=1) < 5e3)
    moved, moved_depth, _ = camera.transformed(R, t).project(points @ R.T + t)
    np.testing.assert_allclose(moved_depth, depth, atol=1e-10)
    np.testing.assert_allclose(moved[steady], uv[steady], atol=1e-6)
    np.testing.assert_allclose(
        camera.transformed(R, t).position, R @ camera.position + t, atol=1e-10
    )


@given(factor=st.integers(1, 9), seed=st.integers(0, 2**32 - 1))
@settings(max_examples=10)
def test_a_shrunken_pixel_looks_where_its_block_is_centred(factor, seed):
    rng = np.random.default_rng(seed)
    camera = Camera("c", (64 * factor + factor - 1, 48 * factor), K, random_lens("brown", rng))
    small = camera.scaled(1 / factor)
    assert small.image_size == (64, 48)
    corner = rng.integers(0, [64, 48])
    block = factor * corner + np.stack(np.mgrid[:factor, :factor], axis=-1).reshape(-1, 2)
    here, there = small.rays([corner])[1], camera.rays([block.mean(axis=0)])[1]
    np.testing.assert_allclose(here, there, atol=1e-12, equal_nan=True)


def test_a_crop_keeps_every_line_of_sight():
    camera = Camera("c", (64, 48), K, Distortion("brown", (-0.2, 0.1, 0.001, 0.002)))
    window = camera.cropped(10, 7, 20, 30)
    assert window.image_size == (20, 30)
    np.testing.assert_allclose(window.rays([[3, 4]])[1], camera.rays([[13, 11]])[1], atol=1e-14)
    with pytest.raises(ValueError, match=r"camera c: crop: .* inside 64 x 48"):
        camera.cropped(50, 0, 20, 10)


def test_all_pixels_come_row_by_row():
    camera = Camera("c", (5, 3), K)
    origins, directions = camera.rays()
    assert origins.shape == directions.shape == (15, 3)
    assert (directions[7] == camera.rays([[2, 1]])[1][0]).all()


def test_inside_is_the_area_of_the_pixels():
    camera = Camera("c", (4, 3), K)
    uv = [[-0.5, 0], [-0.51, 0], [3.49, 2.49], [3.5, 0], [0, 2.5], [np.nan, 0]]
    assert camera.inside(uv).tolist() == [True, False, True, False, False, False]


def test_a_camera_is_a_value():
    rng = np.random.default_rng(3)
    camera = random_camera("tilted", rng)
    assert eval(repr(camera), vars(rigs) | {n: getattr(rigs, n) for n in rigs.__all__}) == camera
    assert hash(camera) == hash(eval(repr(camera), {n: getattr(rigs, n) for n in rigs.__all__}))
    assert camera != random_camera("tilted", rng)
    assert camera != "c"
    with pytest.raises(ValueError, match="read-only"):
        camera.t[0] = 1.0
    with pytest.raises(AttributeError):
        camera.name = "other"


def test_look_at_puts_the_target_in_the_middle_and_up_upwards():
    position, target = np.array([3.0, 4.0, 5.0]), np.array([-1.0, 0.5, 0.2])
    R, t = look_at(position, target, [0, 1, 0])
    camera = Camera("c", (1280, 960), K, R=R, t=t)
    uv, depth, _ = camera.project([target, np.add(target, [0, 0.1, 0])])
    np.testing.assert_allclose(uv[0], [640, 480], atol=1e-9)
    np.testing.assert_allclose(depth[0], np.linalg.norm(target - position))
    np.testing.assert_allclose(camera.position, position, atol=1e-12)
    assert uv[1, 1] < 480  # rows count downwards
    assert abs(uv[1, 0] - 640) < 1e-9
    with pytest.raises(ValueError, match="up: found"):
        look_at([0, 5, 0], [0, 0, 0], [0, 1, 0])


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"R": np.diag([1, 1, -1])}, r"camera c: R: mirrored \(determinant -1\)"),
        ({"R": np.diag([1, 1, 1.01])}, r"camera c: R: not orthonormal .* by 0\.02"),
        ({"R": np.full((3, 3), np.nan)}, "camera c: R: found NaN"),
        ({"t": [0, np.inf, 0]}, "camera c: t: found NaN or infinity"),
        ({"t": ["a", 0, 0]}, "camera c: t: found"),
        ({"camera_matrix": np.diag([1, -1, 1])}, "camera c: camera_matrix: .*positive"),
        ({"camera_matrix": np.diag([1, 1, 2])}, "camera c: camera_matrix: .*lower rows"),
        ({"image_size": (4.5, 4)}, "camera c: image_size"),
        ({"status": "guessed"}, "camera c: status: found 'guessed', expected one of calib"),
        ({"name": "a/b"}, "camera name: found 'a/b'"),
        ({"name": ".."}, "camera name"),
    ],
)
def test_bad_cameras_are_named(change, message):
    fields = {"name": "c", "image_size": (4, 4), "camera_matrix": K}
    with pytest.raises(ValueError, match=message) as caught:
        Camera(**(fields | change))
    assert "\n" not in str(caught.value)


def test_a_slightly_rounded_rotation_becomes_one():
    exact = cv2.Rodrigues(np.array([0.3, -0.2, 0.9]))[0]
    camera = Camera("c", (4, 4), K, R=np.round(exact, 7))
    np.testing.assert_allclose(camera.R @ camera.R.T, np.eye(3), atol=1e-14)
    np.testing.assert_allclose(camera.R, exact, atol=2e-7)
    assert (Camera("c", (4, 4), K, R=camera.R).R == camera.R).all()


@pytest.mark.parametrize(
    ("model", "count", "expected"),
    [
        ("none", 1, "0"),
        ("brown", 8, "4 or 5"),
        ("tilted", 12, "14"),
        ("fisheye", 5, "4"),
    ],
)
def test_each_model_has_its_count(model, count, expected):
    message = f"distortion.coefficients: found {count} for model {model}, expected {expected}$"
    with pytest.raises(ValueError, match=message):
        Distortion(model, (0.0,) * count)


def test_bad_lenses_are_named():
    with pytest.raises(ValueError, match=r"distortion\.model: found 'foo', expected one of none"):
        Distortion("foo")
    with pytest.raises(ValueError, match="found nan at position 1"):
        Distortion("brown", (0, np.nan, 0, 0))
    with pytest.raises(ValueError, match="less than a right angle"):
        Distortion("tilted", (0,) * 12 + (1.6, 0))
    with pytest.raises(ValueError, match=r"optics\.f_number: found -1"):
        Optics(f_number=-1)


@pytest.mark.parametrize(
    ("matrix", "message"),
    [
        ([[1e300, 0, 4], [0, 1e300, 4], [0, 0, 1]], r"1e\+300 .* at most 1e\+09 pixels"),
        ([[80, 0, 4], [0, 8000, 4], [0, 0, 1]], "expected a ratio of at most 10"),
        ([[8000, 0, 4], [0, 80, 4], [0, 0, 1]], "expected a ratio of at most 10"),
        ([[80, 1e6, 4], [0, 80, 4], [0, 0, 1]], r"a skew of 1e\+06, expected at most"),
    ],
)
def test_camera_matrices_that_no_camera_has_are_refused(matrix, message):
    with pytest.raises(ValueError, match=f"camera c: camera_matrix: found .*{message}"):
        Camera("c", (9, 9), matrix)
