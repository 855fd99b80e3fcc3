import io

import cv2
import numpy as np
import pytest
from PIL import Image

from rigs import ring
from tomo import VoxelGrid
from tomo.draw.rig.rig_scene import Target, frustum, symbol_length, symbol_widening
from tomo.draw.rig.thumbnails import contact_sheet, image_scene, load_thumbnails

GRID = VoxelGrid((10, 20, 10), 1.0)
RIG = ring(3, distance=500.0, image_size=(80, 60), footprint=1.0)


def write(path, image):
    path.parent.mkdir(parents=True, exist_ok=True)
    assert cv2.imwrite(str(path), image)


def test_pictures_are_found_by_folder_or_by_name_and_share_one_scale(tmp_path):
    ramp = np.tile(np.arange(80, dtype=np.uint16) * 100, (60, 1))
    write(tmp_path / "cam00" / "b.tif", ramp)
    write(tmp_path / "cam00" / "a.tif", np.zeros((60, 80), np.uint16))
    write(tmp_path / "cam01.png", ramp // 2)
    found = load_thumbnails(RIG, tmp_path, "b")
    assert sorted(found) == ["cam00", "cam01"]
    assert found["cam00"].dtype == np.uint8
    assert found["cam00"][0, [0, -1]].tolist() == [0, 255]
    np.testing.assert_allclose(found["cam01"][0], found["cam00"][0] / 2.0, atol=1.5)
    first = load_thumbnails(RIG, tmp_path)  # the first moment: a
    assert first["cam00"].max() == 0


def test_large_pictures_shrink_by_area(tmp_path):
    rig = ring(1, distance=500.0, image_size=(1600, 1200), footprint=1.0)
    board = (np.indices((1200, 1600)).sum(axis=0) % 2 * 200).astype(np.uint8)
    write(tmp_path / "cam00.png", board)
    (small,) = load_thumbnails(rig, tmp_path).values()
    assert small.shape == (360, 480)
    assert np.ptp(small.astype(int)) < 40  # a fine board turns grey, no pattern of its own


def test_pixels_that_are_no_number_are_dark_and_leave_the_others_their_scale(tmp_path):
    image = np.full((60, 80), 3.0, np.float32)
    image[0, :3] = np.inf, -np.inf, np.nan
    write(tmp_path / "cam00.tif", image)
    found = load_thumbnails(RIG, tmp_path)["cam00"]
    assert found[0, :3].tolist() == [0, 0, 0]
    assert (found[1:] == 255).all()


def test_files_in_other_orders_and_what_they_say(tmp_path):
    image = np.full((60, 80), 9, np.uint8)
    for camera in ("cam00", "cam02"):
        write(tmp_path / f"{camera}_0001.jpg", image)
        write(tmp_path / f"{camera}_0002.jpg", image)
    write(tmp_path / "raw" / "x-cam01.png", image)
    notes = []
    assert sorted(load_thumbnails(RIG, tmp_path, "0002", note=notes.append)) == ["cam00", "cam02"]
    (line,) = notes
    assert line.startswith("cameras cam00, cam02: JPEG has 8 bits")
    assert list(load_thumbnails(RIG, tmp_path, None, "raw/*-{camera}.png")) == ["cam01"]


def test_a_source_without_usable_images_is_refused(tmp_path):
    with pytest.raises(FileNotFoundError, match="nowhere: no such folder"):
        load_thumbnails(RIG, tmp_path / "nowhere")
    with pytest.raises(ValueError, match="found no image of any camera"):
        load_thumbnails(RIG, tmp_path)
    write(tmp_path / "cam02.png", np.zeros((60, 81), np.uint8))
    with pytest.raises(
        ValueError, match="camera cam02: found an image of 81 x 60 pixels, expected 80"
    ):
        load_thumbnails(RIG, tmp_path)
    (tmp_path / "cam02.png").write_bytes(b"no image")
    with pytest.raises(ValueError, match=r"camera cam02: .*cam02\.png: not a readable image"):
        load_thumbnails(RIG, tmp_path)


def test_pictures_hang_the_right_way_in_the_symbols_faces():
    corner = np.zeros((60, 80), np.uint8)
    corner[:20, :20] = 250  # top left
    target = Target.of(RIG, None)
    scene = image_scene(RIG, target, {"cam01": corner})
    (mesh,) = scene.meshes
    assert (mesh.group, mesh.name) == ("images", "cam01")
    camera = RIG["cam01"]
    length = symbol_length(RIG, target)
    np.testing.assert_allclose((mesh.vertices - camera.position) @ camera.R[2], 1.01 * length)
    bright = mesh.vertices[mesh.values > 200].mean(axis=0)
    corners = frustum(camera, 1.01 * length, widen=symbol_widening(camera))
    assert np.linalg.norm(corners - bright, axis=1).argmin() == 0  # top left, see border_rays
    inside = mesh.vertices @ np.linalg.pinv(camera.R[:2]).reshape(3, 2)
    limits = corners @ np.linalg.pinv(camera.R[:2]).reshape(3, 2)
    assert (inside.min(axis=0) >= limits.min(axis=0)).all()
    assert (inside.max(axis=0) <= limits.max(axis=0)).all()


def sheet(count, size=(40, 60), grid=GRID, level=0):
    rig = ring(count, distance=300.0, image_size=size, footprint=0.6)
    images = {name: np.full(size[::-1], level, np.uint8) for name in rig.names}
    return np.asarray(Image.open(io.BytesIO(contact_sheet(rig, images, grid, "a $_ title"))))


@pytest.mark.parametrize(("count", "size"), [(1, (90, 30)), (5, (40, 60))])
def test_every_camera_has_its_picture(count, size):
    shown = sheet(count, size)[..., :3].astype(int)
    black = shown.sum(axis=-1) < 30  # inferno's darkest
    height, width = black.shape
    assert 0.2 < height / width < 3
    cells = black.any(axis=0).sum() / width, black.any(axis=1).sum() / height
    assert min(cells) > 0.5  # no picture is squeezed into a corner
    assert black.mean() > 0.25


def test_the_box_is_drawn_where_it_is_and_not_elsewhere():
    def blue(grid):
        shown = sheet(1, grid=grid)[100:, :, :3].astype(int)  # below the title
        at = np.argwhere((shown[..., 2] > 150) & (shown[..., 0] < 150) & (shown[..., 1] > 120))
        return np.ptp(at, axis=0) if len(at) else np.zeros(2)

    tall, wide = blue(GRID), blue(VoxelGrid((20, 10, 10), 1.0))
    assert tall[0] > 1.5 * tall[1]
    assert wide[1] > 1.5 * wide[0]
    assert not blue(VoxelGrid((10, 20, 10), 1.0, (0, 900, 0))).any()
