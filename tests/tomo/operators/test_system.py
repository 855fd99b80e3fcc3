import numpy as np
import pytest

from rigs import Camera, Rig, ring
from rigs.camera import look_at
from tomo import ActiveVoxels, LinearSystem, VoxelGrid
from tomo.operators.system import VolumeNotSeenError

GRID = VoxelGrid((5, 8, 6), (1.0, 0.8, 1.2), (3.0, -2.0, 1.0))
RIG = ring(3, 70.0, 80.0, image_size=(24, 20), footprint=0.7, center=GRID.center)


@pytest.fixture(scope="module")
def system():
    return LinearSystem.from_rig(RIG, GRID)


def _turned_away(rig, name):
    """Return the rig with one camera looking away from the middle."""
    camera = rig[name]
    R, t = look_at(camera.position, 2 * camera.position - GRID.center, (0, 1, 0))
    K, size = camera.camera_matrix, camera.image_size
    away = Camera(name, size, K, R=R, t=t)
    return Rig(tuple(away if c.name == name else c for c in rig), rig.length_unit)


def test_rows_lie_where_their_pixels_do(system):
    random = np.random.default_rng(0)
    images = [random.random((20, 24)).astype(np.float32) for _ in RIG]
    flat = system.flatten(images)
    assert flat.shape == (system.projector.shape[0],)
    for image, back, pixels in zip(images, system.images(flat), system.pixels, strict=True):
        expected = np.zeros(image.size, np.float32)
        expected[pixels] = image.ravel()[pixels]
        np.testing.assert_array_equal(back.ravel(), expected)


def test_a_voxel_appears_where_its_camera_projects_it():
    system = LinearSystem.from_rig(RIG, GRID, supersample=6)
    for voxel in (0, 101, GRID.size - 1):
        volume = np.zeros(GRID.size, np.float32)
        volume[voxel] = 1
        centre = GRID.centers().reshape(-1, 3)[voxel]
        for camera, image in zip(RIG, system.images(system.projector @ volume), strict=True):
            v, u = np.indices(image.shape)
            middle = np.array([(u * image).sum(), (v * image).sum()]) / image.sum()
            np.testing.assert_allclose(middle, camera.project(centre[None])[0][0], atol=0.1)


def test_skipping_leaves_out_just_the_pixels_that_see_nothing(system):
    whole = LinearSystem.from_rig(RIG, GRID, skip=False)
    assert whole.projector.shape[0] == 3 * 20 * 24 > system.projector.shape[0]
    assert (system.projector.row_sums > 0).all()
    volume = np.random.default_rng(1).random(GRID.size).astype(np.float32)
    seen, all_seen = (s.images(s.projector @ volume) for s in (system, whole))
    np.testing.assert_array_equal(seen, all_seen)
    assert np.count_nonzero(all_seen) == system.projector.shape[0]


def test_masked_pixels_own_no_row():
    masks = [np.random.default_rng(n).random((20, 24)) < 0.5 for n in range(3)]
    for skip in (True, False):
        system = LinearSystem.from_rig(RIG, GRID, masks=masks, skip=skip)
        for mask, pixels in zip(masks, system.pixels, strict=True):
            assert mask.ravel()[pixels].all()
        if not skip:
            assert [len(pixels) for pixels in system.pixels] == [mask.sum() for mask in masks]


@pytest.mark.parametrize("share", [1.0, 0.1])
def test_tracing_in_chunks_changes_nothing(monkeypatch, share):
    mask = np.random.default_rng(4).random(GRID.shape) < share
    how = {"active": ActiveVoxels.from_mask(GRID, mask)}
    whole = LinearSystem.from_rig(RIG, GRID, **how).projector
    monkeypatch.setattr("tomo.operators.assembly.RAYS_AT_ONCE", 37)
    chunked = LinearSystem.from_rig(RIG, GRID, midpoints=True, **how).projector
    np.testing.assert_array_equal(chunked.view_ptr, whole.view_ptr)
    for name in ("ptr", "voxel", "length"):
        expected = getattr(whole.segments, name)
        np.testing.assert_array_equal(getattr(chunked.segments, name), expected)
    assert chunked.segments.midpoint.shape == (len(whole.segments), 3)
    assert whole.segments.midpoint is None


@pytest.mark.parametrize("rays", [7, 1000])
def test_any_number_of_threads_traces_the_same(monkeypatch, rays, on_threads):
    monkeypatch.setattr("tomo.operators.assembly.RAYS_AT_ONCE", rays)
    found = []
    for threads in (1, 2):
        with on_threads(threads):
            found.append(LinearSystem.from_rig(RIG, GRID, midpoints=True))
    one, other = found
    for name in ("ptr", "voxel", "length", "midpoint"):
        pair = (getattr(system.projector.segments, name) for system in found)
        np.testing.assert_array_equal(*pair)
    for own, others in zip(one.pixels, other.pixels, strict=True):
        np.testing.assert_array_equal(own, others)


@pytest.mark.parametrize("tracer", ["raycast", "reference"])
def test_tracers_build_the_same_matrix(system, tracer):
    other = LinearSystem.from_rig(RIG, GRID, tracer=tracer)
    apart = (other.projector.to_scipy() - system.projector.to_scipy()).toarray()
    assert np.abs(apart).max() < 1e-5 * min(GRID.spacing)


def test_chords_over_the_pixels_areas_fill_the_volume():
    system = LinearSystem.from_rig(RIG, GRID, supersample=4)
    for image in system.images(system.projector.row_sums):
        area = 0.7**2  # of a pixel at the grid's middle
        assert image.sum() * area == pytest.approx(np.prod(GRID.extent), rel=0.01)


@pytest.mark.parametrize("skip", [True, False])
def test_blind_cameras_are_named(skip):
    system = LinearSystem.from_rig(_turned_away(RIG, "cam01"), GRID, skip=skip)
    assert system.blind == ("cam01",)
    assert system.images(system.projector.row_sums)[1].max() == 0


def test_a_camera_masked_all_over_is_blind(system):
    masks = [np.ones((20, 24), bool), np.zeros((20, 24), bool), np.ones((20, 24), bool)]
    assert LinearSystem.from_rig(RIG, GRID, masks=masks).blind == ("cam01",)
    assert system.blind == ()


@pytest.mark.parametrize("skip", [True, False])
def test_a_box_out_of_view_is_refused_with_where_the_view_is(skip):
    grid = VoxelGrid(GRID.shape, GRID.spacing, (500.0, 0.0, 0.0))
    with pytest.raises(VolumeNotSeenError, match=r"of cam00, cam01, cam02 sees it") as caught:
        LinearSystem.from_rig(RIG, grid, skip=skip)
    assert "grid from (497.5, -3.2, -3.6) to (502.5, 3.2, 3.6) mm" in str(caught.value)
    assert "meet near (3, -2, 1)" in str(caught.value)


def test_progress_names_every_camera():
    calls = []
    LinearSystem.from_rig(RIG, GRID, progress=lambda *call: calls.append(call))
    assert calls == [(0, 3, "cam00"), (1, 3, "cam01"), (2, 3, "cam02"), (3, 3, "")]


def test_images_of_other_numbers_are_refused(system):
    with pytest.raises(ValueError, match="images: found 2, expected one for each of 3 cameras"):
        system.flatten([np.zeros((20, 24), np.float32)] * 2)


def test_on_the_fly_is_the_same_system():
    stored = LinearSystem.from_rig(RIG, GRID, form="stored")
    flying = LinearSystem.from_rig(RIG, GRID, form="on-the-fly")
    assert (stored.form, flying.form) == ("stored", "on-the-fly")
    assert flying.blind == stored.blind
    for mine, theirs in zip(flying.pixels, stored.pixels, strict=True):
        assert np.array_equal(mine, theirs)
    x = np.random.default_rng(0).random(GRID.size)
    assert flying.projector @ x == pytest.approx(stored.projector @ x, rel=1e-5)


def test_images_of_another_shape_are_not_flattened():
    grid = VoxelGrid((4, 6, 4), 1.0)
    rig = ring(3, 60.0, 100.0, image_size=(8, 12), footprint=0.8)
    system = LinearSystem.from_rig(rig, grid)
    images = [np.zeros((12, 8), np.float32)] * 3
    with pytest.raises(ValueError, match=r"camera cam01: found shape \(8, 12\), expected \(12, 8"):
        system.flatten([images[0], images[1].T, images[2]])
