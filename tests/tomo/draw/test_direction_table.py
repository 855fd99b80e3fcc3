import numpy as np
import pytest
from scipy.interpolate import interpn

from rigs import Camera, Distortion, RayTable, look_at
from rigs.scene import Mirror, Scene, SceneCamera
from tomo.draw.rig.camera_view import DirectionTable

BROWN = Distortion("brown", (-0.25, 0.08, 1e-3, -2e-3, 0.01))


def camera(distortion=None, focal=700.0):
    K = [[focal, 3.0, 411.0], [0, 1.1 * focal, 290.0], [0, 0, 1]]
    return Camera("c", (800, 600), K, distortion or Distortion(), t=[1.0, 2.0, 3.0])


@pytest.mark.parametrize(
    ("distortion", "focal"),
    [
        (None, 700.0),
        (BROWN, 700.0),
        (BROWN, 450.0),
        (Distortion("fisheye", (0.02, -0.01, 0.0, 0.0)), 400.0),
        (Distortion("rational", (-0.3, 0.1, 0.001, 0.001, 0.02, -0.1, 0.03, 0.01)), 900.0),
    ],
)
def test_directions_are_the_camera_s_to_a_twentieth_of_a_pixel(distortion, focal):
    seen = camera(distortion, focal)
    table = DirectionTable.of(seen)
    uv = np.random.default_rng(0).uniform(-0.5, [799.5, 599.5], (4000, 2))
    true = seen.rays(uv)[1]
    off = np.linalg.norm(np.cross(table.directions(uv), true), axis=1)
    assert (table.directions(uv) * true).sum(axis=1).min() > 0
    assert off.max() * 1.1 * focal < 0.06
    np.testing.assert_allclose(np.linalg.norm(table.directions(uv), axis=1), 1)


def test_where_the_lens_maps_nothing_there_is_no_direction():
    seen = camera(Distortion("brown", (-0.25, 0, 0, 0)), 100.0)
    uv = np.random.default_rng(2).uniform(-0.5, [799.5, 599.5], (2000, 2))
    maps = np.isfinite(seen.rays(uv)[1]).all(axis=1)
    found = np.isfinite(DirectionTable.of(seen).directions(uv)).all(axis=1)
    assert 0.02 < maps.mean() < 0.98
    assert not (found & ~maps).any() or (found & ~maps).mean() < 0.01
    assert found.sum() > 0.7 * maps.sum()  # a cell along the lens's border is lost


def test_rays_that_do_not_meet_have_origins_of_their_own():
    seen = camera(BROWN)
    small = seen.scaled(0.1)
    _, directions = small.rays()
    directions = directions.reshape(60, 80, 3)
    columns, rows = np.meshgrid(np.arange(80), np.arange(60))
    origins = np.stack([0.1 * columns, 0.2 * rows, 1 + 0 * rows], axis=-1)
    bundle = RayTable("fibres", origins, directions)
    table = DirectionTable.of(bundle)
    uv = np.random.default_rng(3).uniform(1, [78, 58], (300, 2))
    true_origins, true = bundle.rays(uv)
    off = np.linalg.norm(np.cross(table.directions(uv), true), axis=1)
    assert off.max() * small.camera_matrix[1, 1] < 0.06
    axes = [np.linspace(-0.5, n - 0.5, len(table.origins)) for n in (60, 80)]
    found = interpn(axes, table.origins, uv[:, ::-1])  # linear ones here
    # a point on the ray, wherever along it
    off = np.linalg.norm(np.cross(found - true_origins, true), axis=1)
    assert off.max() < 1e-3
    assert DirectionTable.of(seen).origins is None


def test_rays_by_a_mirror_are_drawn_from_the_camera_to_the_mirror():
    R, t = look_at((60.0, 0, 300), (60, 0, 0))
    own = Camera("side", (40, 30), [[400, 0, 19.5], [0, 400, 14.5], [0, 0, 1]], R=R, t=t)
    mirror = Mirror("m", (60, 0, 0), (-1, 0, 1))
    table = DirectionTable.of(SceneCamera(own, Scene((mirror,))))
    (start,) = table.corners
    np.testing.assert_allclose(start, np.broadcast_to([60, 0, 300], start.shape), atol=1e-12)
    bends = table.origins - mirror.point
    np.testing.assert_allclose(bends @ np.array(mirror.normal), 0, atol=1e-10)
    assert (table.nodes[..., 0] < 0).all()  # from the mirror towards the origin
