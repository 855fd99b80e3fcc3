"""The box that images ask for holds the light, and little more; where it cannot, that is said."""

from dataclasses import replace

import numpy as np
import pytest

from rigs import RayTable
from tomo import Scan
from tomo.scan.propose import box as box_module
from tomo.scan.propose.box import box_of_light, grid_in


def scan_of(scene, change=lambda image: image):
    images = {camera: change(image) for camera, image in scene.images.items()}
    return Scan.from_arrays(scene.rig, images)


def light_inside(scene, found):
    """Return the fraction of the true emission that a box holds."""
    points = scene.grid.centers()
    inside = ((points >= found.lower) & (points <= found.upper)).all(axis=-1)
    return float(scene.truth[inside].sum() / scene.truth.sum())


@pytest.mark.parametrize("noise", [0.0, 0.01])
@pytest.mark.parametrize("level", [0.0, 0.4])
def test_the_box_holds_the_light_and_little_more(scene, noise, level):
    rng = np.random.default_rng(1)
    top = max(image.max() for image in scene.images.values())
    noisy = scan_of(
        scene,
        lambda i: i + level * top * 0.1 + rng.normal(0, noise * top, i.shape).astype(np.float32),
    )
    found = box_of_light(noisy, ["frame_000"])
    assert light_inside(scene, found) > 0.995
    bright = scene.grid.centers()[scene.truth > 0.02 * scene.truth.max()]
    needed = bright.max(axis=0) - bright.min(axis=0)
    assert ((found.upper - found.lower) < 1.6 * needed + 1.0).all()
    assert not found.cut
    assert "around the light of frame frame_000 in 6 views" in found.reason


def test_all_frames_that_are_looked_at_are_in_the_box(scene):
    turned = {camera: image[::-1].copy() for camera, image in scene.images.items()}
    both = {camera: np.stack([scene.images[camera], turned[camera]]) for camera in turned}
    scan = Scan.from_arrays(scene.rig, both)
    one, other, all_of_them = (
        box_of_light(scan, frames)
        for frames in (["frame_000"], ["frame_001"], ["frame_000", "frame_001"])
    )
    np.testing.assert_array_equal(all_of_them.lower, np.minimum(one.lower, other.lower))
    np.testing.assert_array_equal(all_of_them.upper, np.maximum(one.upper, other.upper))


def test_tables_of_rays_look_as_their_cameras_do(scene):
    tables = replace(scene.rig, cameras=tuple(RayTable.of(camera) for camera in scene.rig))
    found, known = (
        box_of_light(Scan.from_arrays(rig, scene.images), ["frame_000"])
        for rig in (tables, scene.rig)
    )
    np.testing.assert_allclose(found.lower, known.lower, atol=0.8)
    np.testing.assert_allclose(found.upper, known.upper, atol=0.8)


def test_dark_images_leave_what_the_cameras_see(scene):
    found = box_of_light(scan_of(scene, np.zeros_like), ["frame_000"])
    assert "make it no smaller: no pixel is certainly bright" in found.reason
    assert (found.lower < scene.grid.lower).all()
    assert (found.upper > scene.grid.upper).all()
    assert ((found.upper - found.lower) > scene.grid.extent).all()


def test_light_that_images_cut_is_named(scene):
    def shifted(image):
        return np.roll(image, 28, axis=0)  # the flame leaves the image at the bottom

    found = box_of_light(scan_of(scene, shifted), ["frame_000"])
    assert set(found.cut) == set(scene.rig.names)


def test_cameras_that_look_past_each_other_ask_for_the_box(scene, monkeypatch):
    monkeypatch.setattr(box_module, "point_in_view", lambda rig: None)
    with pytest.raises(ValueError, match="grid: found cameras whose axes do not meet, expected"):
        box_of_light(scan_of(scene), ["frame_000"])


def test_voxels_fill_the_box_and_are_as_asked(scene):
    found = box_of_light(scan_of(scene), ["frame_000"])
    for voxel in (None, 0.7):
        grid, scale, check = grid_in(scene.rig, found, voxel)
        assert scale >= 1
        slack = 0.06 * grid.spacing[0]  # the centre is rounded to a tenth of a voxel
        assert (grid.lower <= found.lower + slack).all()
        assert (grid.upper >= found.upper - slack).all()
        assert (grid.extent < found.upper - found.lower + 1.01 * grid.spacing[0]).all()
        assert voxel is None or grid.spacing[0] == voxel
    assert check.cameras
