"""Poses of cameras with distortion, tables of rays, and cameras behind glass and by mirrors."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import rigs
from phantoms import GaussianBlobs, sample
from rigs import Distortion, RayTable, Rig, Volume
from rigs.scene import Cylinder, Glass, Mirror, Scene, Window
from rigs.scene.scene_camera import own_camera
from tomo.grid import VoxelGrid
from tomo.inference.fit import equations_of
from tomo.inference.infer import infer
from tomo.measurement import NoiseModel, estimate_noise
from tomo.model import Observation, Pose
from tomo.model.effect import Prediction
from tomo.model.gauge import scene_motions
from tomo.model.pose import moved
from tomo.simulation import simulate_images

GRID = VoxelGrid((24, 32, 24), 0.5)
MIDDLE = np.zeros(3)
POINTS = np.random.default_rng(0).uniform(-4, 4, (20, 3))
FIELD = GaussianBlobs(
    [[1.0, -1.0, -0.6], [-1.5, 2.0, 1.6], [0.6, -3.0, 1.2]], [1.3, 1.2, 0.9], [1.0, 0.8, 0.9]
)
LENS = rigs.ring(
    6, distance=60.0, image_size=(36, 48), footprint=0.6, pitch_degrees=12.0, start_degrees=11.0
)[0]


def through(camera, *solids):
    """Return the camera as it looks through solids."""
    rig = Rig((camera,), volume=Volume(GRID.shape, GRID.spacing, GRID.center))
    return rig.through(Scene(solids))[0]


def unit(vector):
    return tuple(vector / np.linalg.norm(vector))


def by_mirror():
    """Return a camera that sees by a mirror what `LENS` sees directly, turned over."""
    back = LENS.position / np.linalg.norm(LENS.position)
    normal, point = np.array(unit(LENS.R[0] - back)), 40 * back
    turned_over = np.eye(3) - 2 * np.outer(normal, normal)
    R = np.diag([-1.0, 1, 1]) @ LENS.R @ turned_over
    position = point + turned_over @ (LENS.position - point)
    camera = replace(LENS, R=R, t=-R @ position)
    return through(camera, Mirror("mirror", tuple(point), tuple(normal)))


def cameras():
    R, place = LENS.R, tuple(-25 * LENS.R[2])
    K = LENS.shifted(2, -3).camera_matrix
    bent = replace(
        LENS, camera_matrix=K, distortion=Distortion("brown", (-0.6, 0.3, 0.002, -0.001))
    )
    pane = Window("pane", place, unit(-R[2] + 0.3 * R[0] + 0.4 * R[1]), 6.0, Glass(1.5))
    tank = Window("tank", place, unit(-R[2] + 0.1 * R[0]), 2.0, Glass(1.5), beyond=1.33)
    tube = Cylinder("tube", (0, 0, 0), (0, 1, 0), 14.0, 80.0, Glass(1.5), inner_radius=12.0)
    return {
        "lens": LENS,
        "distorted": bent,
        "table": RayTable.of(bent),
        "pane": through(bent, pane),
        "tank": through(LENS, tank),
        "tube": through(LENS, tube),
        "mirror": by_mirror(),
        "table behind a pane": through(RayTable.of(LENS), pane),
    }


CAMERAS = cameras()
BENT = [name for name, camera in CAMERAS.items() if not camera.is_straight]
ALL = pytest.mark.parametrize("kind", CAMERAS)


@pytest.fixture(scope="module")
def volume():
    return sample(FIELD, GRID, 2).astype(np.float32)


def shown(rig, volume):
    """Return what a rig sees of the volume: the observation, the equations, unknowns, images."""
    blank = np.zeros(LENS.image_size[::-1], np.float32)
    many = len(rig)
    seen = Observation(
        rig, (blank,) * many, (blank == 0,) * many, (NoiseModel(0.01),) * many, GRID, supersample=3
    )
    (system,) = equations_of([seen], None, [volume])
    unknowns = system.projector.active.compress(volume)
    return seen, system, unknowns, system.images(system.projector @ unknowns)


@ALL
def test_columns_are_finite_differences(kind, volume):
    """Images that moved cameras take are compared, each ray traced anew."""
    camera, step = CAMERAS[kind], 0.7
    seen, system, unknowns, _ = shown(Rig((camera,)), volume)
    columns = Pose().columns(Prediction(seen, system, unknowns))
    ways = [sign * step * one for one in np.eye(6) for sign in (1, -1)]
    there = [moved(camera, way, MIDDLE).renamed(str(n)) for n, way in enumerate(ways)]
    images = np.array(shown(Rig(tuple(there)), volume)[3], np.float64)
    changes = (images[::2] - images[1::2]).reshape(6, -1)[:, system.pixels[0]] / (2 * step)
    turned = (0, 1, 2, 3, 4, 5) if own_camera(camera).has_pose else (0, 1, 4, 5)
    for column, change in zip(columns[[*turned]], changes[[*turned]], strict=True):
        both = float(column @ change)
        assert both / np.sqrt((column @ column) * (change @ change)) > 0.99
        assert 0.95 < both / (column @ column) < 1.16  # smoothing flattens slopes
    assert not changes[[k for k in range(6) if k not in turned]].any()


@pytest.mark.parametrize("kind", BENT)
def test_the_camera_moves_and_the_scene_stays(kind):
    camera = CAMERAS[kind]
    there = moved(camera, np.array([1.0, -0.5, 0.8, 0.6, 1.5, -1.0]), MIDDLE)
    assert there.scene is camera.scene
    assert there.camera != camera.camera
    assert moved(camera, np.zeros(6), MIDDLE) == camera


@ALL
def test_images_shift_turn_and_grow_about_the_lens(kind):
    camera = CAMERAS[kind]
    own, radius = own_camera(camera), min(camera.image_size) / 2
    before = camera.project(POINTS)[0]
    shift = moved(camera, np.array([1.3, -0.8, 0, 0, 0, 0]), MIDDLE).project(POINTS)[0] - before
    np.testing.assert_allclose(shift, np.tile([1.3, -0.8], (20, 1)), atol=0.01)
    if not own.has_pose or own.distortion.coefficients:
        return  # tangential terms make no turn of a turn
    angle, growth = 1.2 / radius, np.exp(0.9 / radius)
    c, s = np.cos(angle), np.sin(angle)
    center = own.camera_matrix[:2, 2]
    found = moved(camera, np.array([0, 0, 1.2, 0.9, 0, 0]), MIDDLE).project(POINTS)[0] - center
    np.testing.assert_allclose(found, growth * (before - center) @ [[c, s], [-s, c]], atol=1e-6)


@ALL
def test_a_walk_keeps_the_middle_in_its_place(kind):
    camera = CAMERAS[kind]
    for one in np.eye(6)[4:]:
        there = moved(camera, one, MIDDLE)
        gone = there.project(MIDDLE[None])[0] - camera.project(MIDDLE[None])[0]
        assert np.abs(gone).max() < 0.05  # of a pixel by which nearer points move
        assert np.linalg.norm(there.project(POINTS)[0] - camera.project(POINTS)[0]) > 0.1


@ALL
def test_a_moved_scene_looks_like_moved_cameras(kind, volume):
    """The gauge of these cameras: motions of the light are motions of the camera."""
    camera = CAMERAS[kind]
    seen = shown(Rig((camera,)), volume)[0]
    motions = scene_motions(seen, volume)[0][0]  # (6, 7)
    step = 0.01 * min(GRID.extent)
    centers = GRID.centers().reshape(-1, 3)
    points = centers[np.argsort(volume.ravel())[-200::10]]
    for way in LENS.R[:2]:  # along its line of sight images grow, which tables cannot
        change = camera.project(points + step * way)[0] - camera.project(points)[0]
        there = moved(camera, motions[:, :3] @ way, MIDDLE).project(points)[0]
        far = np.abs(change).max()
        assert far > 0.1
        np.testing.assert_allclose(there - camera.project(points)[0], change, atol=0.1 * far)


def test_a_camera_behind_glass_that_was_knocked_is_moved_back():
    """The true camera is made without `moved`: another lens in another pose, the same pane."""
    grid, wrong, motion = VoxelGrid((12, 16, 12), 1.0), 2, (1.0, -0.5, 2.0, 1.0)
    lenses = rigs.ring(
        6, distance=60.0, image_size=(36, 48), footprint=0.6, pitch_degrees=[12.0, -14.0] * 3,
        start_degrees=11.0,
    )  # fmt: skip
    own = lenses[wrong]
    place, normal = tuple(-25 * own.R[2]), unit(-own.R[2] + 0.3 * own.R[0] + 0.4 * own.R[1])
    scene = Scene((Window("pane", place, normal, 6.0, Glass(1.5), size=20.0),))
    radius = min(own.image_size) / 2
    turn = Rotation.from_rotvec([0, 0, motion[2] / radius]).as_matrix()
    K = np.array(own.camera_matrix)
    K[:2, :2] *= np.exp(motion[3] / radius)
    K[:2, 2] += motion[:2]
    there = [*lenses]
    there[wrong] = replace(own, camera_matrix=K, R=turn @ own.R, t=turn @ own.t)
    true = Rig(tuple(there)).through(scene)
    made = simulate_images(true, FIELD, grid, supersample=2, refine=2, noise=0.005)
    images = tuple(made.images.values())
    masks = tuple(np.ones(image.shape, bool) for image in images)
    noise = tuple(map(estimate_noise, images, masks))
    seen = Observation(lenses.through(scene), images, masks, noise, grid)
    state = infer([seen], (Pose(),), look_outside=False).state
    assert np.flatnonzero(state.free["pose"].any(axis=1)).tolist() == [wrong]
    np.testing.assert_allclose(state.values["pose"][wrong, :4], motion, atol=0.2)
    assert np.abs(state.values["pose"][wrong, 4:]).max() < 0.4
