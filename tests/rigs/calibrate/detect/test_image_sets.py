"""Images in folders and videos, the cache, and what is said of images that will not do."""

import os
import struct

import cv2
import numpy as np
import pytest
import tifffile

from rigs.calibrate.detect import VideoFrame, detections, image_set, observe
from rigs.calibrate.detect._detection_run import read_cache
from rigs.calibrate.detect.image_sets import notes_of, read_source
from rigs.calibrate.targets import parse_target

TARGET = parse_target("chessboard:5x4:1.0")


def board(shift=0, size=(200, 160)):
    """A board seen straight on, ``shift`` pixels to the right."""
    drawn, _ = TARGET.drawing(16)
    image = np.full(size[::-1], 120, np.uint8)
    image[10 : 10 + drawn.shape[0], 20 + shift : 20 + shift + drawn.shape[1]] = drawn
    return cv2.GaussianBlur(image, (0, 0), 0.8)


@pytest.fixture
def folder(tmp_path):
    """Two cameras and three moments, one of them seen by one camera alone."""
    for camera, shift in (("cam2", 0), ("cam10", 5)):
        (tmp_path / camera).mkdir()
        for frame in range(2 + (camera == "cam2")):
            cv2.imwrite(str(tmp_path / camera / f"{frame}.png"), board(shift + 3 * frame))
    return tmp_path


def test_equal_file_names_are_one_moment(folder):
    (folder / "cam2" / "notes.txt").write_text("not an image")
    (folder / "cam2" / ".hidden.png").write_text("nor this")
    images = image_set(folder)
    assert {name: list(frames) for name, frames in images.items()} == {
        "cam2": ["0", "1", "2"],
        "cam10": ["0", "1"],
    }
    seen = observe(images, TARGET)
    assert seen.cameras == ("cam2", "cam10")
    assert seen.frames == ("0", "1", "2")
    np.testing.assert_array_equal(seen.counts(), [[20, 20, 20], [20, 20, 0]])
    assert seen.image_sizes == ((200, 160), (200, 160))
    # A shift by whole pixels shifts what is found by as much
    first = seen.uv[(seen.camera == 0) & (seen.frame == 0)]
    np.testing.assert_allclose(
        seen.uv[(seen.camera == 1) & (seen.frame == 1)], np.add(first, (8, 0)), atol=2e-3
    )


def test_results_do_not_depend_on_the_number_of_workers(folder):
    images = image_set(folder)
    assert observe(images, TARGET, workers=1) == observe(images, TARGET, workers=3)


def test_the_cache_is_used_until_an_image_or_the_target_changes(folder, tmp_path, monkeypatch):
    images, cache = image_set(folder), tmp_path / "out" / "detections.npz"
    calls = []
    first = observe(images, TARGET, cache=cache, progress=lambda *at: calls.append(at))
    assert calls == [(k, 5) for k in range(6)]

    looked_at = []
    import rigs.calibrate.detect._detection_run as module

    def counted(source, read=module.read_source):
        looked_at.append(source.name)
        return read(source)

    monkeypatch.setattr(module, "read_source", counted)
    assert observe(images, TARGET, cache=cache) == first
    assert not looked_at
    path = folder / "cam2" / "1.png"
    cv2.imwrite(str(path), board(9))
    os.utime(path, ns=(1, 1))
    again = observe(images, TARGET, cache=cache)
    assert looked_at == ["1.png"]
    assert again != first
    looked_at.clear()
    observe(images, parse_target("chessboard:5x4:2.0"), cache=cache)
    assert len(looked_at) == 5
    assert [item.name for item in cache.parent.iterdir()] == ["detections.npz"]


def test_the_cache_tells_images_of_equal_name_size_and_time_apart(tmp_path):
    """As unpacked archives have them: times in whole seconds, sizes without compression."""
    seen = []
    for shift in (0, 9):
        folder = tmp_path / str(shift) / "cam"
        folder.mkdir(parents=True)
        cv2.imwrite(str(folder / "0.pgm"), board(shift))
        os.utime(folder / "0.pgm", (1e9, 1e9))
        seen.append(observe(image_set(folder.parent), TARGET, cache=tmp_path / "cache").uv)
    np.testing.assert_allclose(seen[1], np.add(seen[0], (9, 0)), atol=2e-3)


def test_another_file_is_not_overwritten_by_the_cache(folder, tmp_path):
    path = tmp_path / "rig.yaml"
    path.write_text("format: emission-rig")
    with pytest.raises(
        ValueError, match=r"rig.yaml: found another kind of file, expected a cache"
    ):
        observe(image_set(folder), TARGET, cache=path)
    assert path.read_text() == "format: emission-rig"


def test_a_damaged_cache_is_reported(folder, tmp_path):
    path = tmp_path / "cache"
    observe(image_set(folder), TARGET, cache=path)
    whole = path.read_bytes()
    lines = []
    for at in range(0, len(whole), 10):
        path.write_bytes(whole[:at] + bytes([whole[at] ^ 0x5A]) + whole[at + 1 :])
        try:
            read_cache(path)
        except ValueError as error:
            lines.append(str(error))
    assert len(lines) > 0.5 * len(whole) / 10
    assert all("expected a cache of detections" in line for line in lines)


@pytest.fixture
def videos(tmp_path):
    """Two videos of five pictures."""
    for camera, shift in (("left", 0), ("right", 4)):
        writer = cv2.VideoWriter(
            str(tmp_path / f"{camera}.avi"), cv2.VideoWriter.fourcc(*"MJPG"), 10, (200, 160)
        )
        for frame in range(5):
            writer.write(cv2.cvtColor(board(shift + 2 * frame), cv2.COLOR_GRAY2BGR))
        writer.release()
    return tmp_path


def test_pictures_of_videos_are_moments(videos):
    images = image_set(videos, every=2)
    assert list(images) == ["left", "right"]
    assert images["left"] == {f"{k:06d}": VideoFrame(videos / "left.avi", k) for k in (0, 2, 4)}
    seen = observe(images, TARGET, workers=2)
    np.testing.assert_array_equal(seen.counts(), np.full((2, 3), 20))
    start = [seen.uv[(seen.camera == 1) & (seen.frame == k)][0, 0] for k in range(3)]
    np.testing.assert_allclose(np.diff(start), 4, atol=0.1)
    np.testing.assert_array_equal(read_source(images["right"]["000002"]).shape, (160, 200))


def test_a_video_that_cannot_be_decoded_is_named(videos):
    path = videos / "left.avi"
    content = path.read_bytes()
    path.write_bytes(content[: len(content) // 2])
    with pytest.raises(ValueError, match=r"left.avi: .*decod|left.avi: not a readable video"):
        image_set(videos)
    path.write_bytes(b"no video at all")
    with pytest.raises(ValueError, match=r"left.avi: not a readable video"):
        image_set(videos)


def test_folders_that_hold_no_image_set_are_named(tmp_path):
    with pytest.raises(ValueError, match="found no folder"):
        image_set(tmp_path / "absent")
    with pytest.raises(ValueError, match="found neither, expected one folder or one video per"):
        image_set(tmp_path)
    cv2.imwrite(str(tmp_path / "loose.png"), board())
    with pytest.raises(ValueError, match="found 1 images outside camera folders"):
        image_set(tmp_path)
    (tmp_path / "left").mkdir()
    with pytest.raises(
        ValueError, match=r"camera left: found no images \(it is empty\), expected some of .tif"
    ):
        image_set(tmp_path)
    cv2.imwrite(str(tmp_path / "left" / "a.png"), board())
    cv2.imwrite(str(tmp_path / "left" / "a.tif"), board())
    with pytest.raises(ValueError, match="camera left: found the frame 'a' twice"):
        image_set(tmp_path)
    (tmp_path / "right.avi").write_bytes(b"")
    with pytest.raises(ValueError, match=r"found the folder left and the video right.avi"):
        image_set(tmp_path)


def test_images_beside_each_other_are_cameras_by_their_names(folder, tmp_path_factory):
    flat = tmp_path_factory.mktemp("flat")
    for camera in ("cam2", "cam10"):
        for path in (folder / camera).iterdir():
            (flat / f"{camera}_{path.name}").write_bytes(path.read_bytes())
    assert {name: list(frames) for name, frames in image_set(flat).items()} == {
        "cam2": ["0", "1", "2"],
        "cam10": ["0", "1"],
    }
    found = image_set(folder, pattern="{camera}/{frame}.png")
    assert {name: list(frames) for name, frames in found.items()} == {
        "cam2": ["0", "1", "2"],
        "cam10": ["0", "1"],
    }
    with pytest.raises(
        ValueError, match=r"pattern: found no image whose name fits '\{camera\}\.x"
    ):
        image_set(folder, pattern="{camera}.x")


def test_pages_of_tiffs_are_moments(tmp_path):
    for camera, shift in (("left", 0), ("right", 4)):
        pages = np.stack([board(shift + 2 * k) for k in range(4)])
        tifffile.imwrite(tmp_path / f"{camera}.tif", pages, photometric="minisblack")
    images = image_set(tmp_path, every=2)
    assert images["left"] == {f"{k:06d}": VideoFrame(tmp_path / "left.tif", k) for k in (0, 2)}
    np.testing.assert_array_equal(read_source(images["right"]["000002"]), board(8))
    assert observe(images, TARGET).counts().tolist() == [[20, 20], [20, 20]]


def test_films_are_found_by_a_pattern_and_not_mixed_with_images(videos):
    for name in ("left", "right"):
        (videos / f"{name}.avi").rename(videos / f"run3 {name}.avi")
    images = image_set(videos, 4, pattern="run3 {camera}.avi")
    assert images["left"] == {f"{k:06d}": VideoFrame(videos / "run3 left.avi", k) for k in (0, 4)}
    with pytest.raises(ValueError, match="bayer: found a film, expected image files"):
        image_set(videos, are_mosaics=True)
    for path in videos.iterdir():
        path.unlink()
    tifffile.imwrite(videos / "a.tif", np.stack([board()] * 2), photometric="minisblack")
    tifffile.imwrite(videos / "b.tif", board())
    with pytest.raises(ValueError, match=r"found a\.tif of many pages and b\.tif of one image"):
        image_set(videos)


def test_a_folder_of_other_files_is_no_camera_and_said_to_be_none(folder):
    (folder / "notes").mkdir()
    (folder / "notes" / "a.txt").touch()
    notes = []
    assert list(image_set(folder, note=notes.append)) == ["cam2", "cam10"]
    (line,) = notes
    assert "notes: holds no image" in line
    (folder / "notes" / "a.cine").touch()
    with pytest.raises(ValueError, match=r"camera notes: found no images \(\.cine, \.txt\)"):
        image_set(folder)


def test_what_files_say_is_noted_once_for_all_cameras(videos):
    (note,) = notes_of(image_set(videos))
    assert note.startswith("cameras left, right: a video has 8 bits")


def test_a_mosaic_is_searched_without_its_pattern(tmp_path):
    """Colours of unequal gain would be edges: the points are those of the grey image."""
    image = board().astype(np.float32)
    factors = np.tile([[0.5, 1.0], [1.0, 0.3]], (80, 100))
    expected = observe({"cam": {"a": board()}}, TARGET)
    (tmp_path / "cam").mkdir()
    path = tmp_path / "cam" / "a.tif"
    for kind in ("cfa", "minisblack"):  # the file says so, or the user
        tifffile.imwrite(path, np.uint16(image * factors * 200), photometric=kind)
        images = image_set(tmp_path, are_mosaics=kind != "cfa")
        plain = read_source(images["cam"]["a"])
        assert np.abs(np.diff(plain[:8, :8])).max() < 1e-3 * plain.max()  # the even background
        seen = observe(images, TARGET, cache=tmp_path / "cache")
        np.testing.assert_allclose(seen.uv, expected.uv, atol=0.02)
    with pytest.raises(ValueError, match="which none of its 1 images shows"):
        observe(image_set(tmp_path), TARGET, cache=tmp_path / "cache")  # as a grey image


@pytest.mark.parametrize("kind", ["uint8", "uint16", "int16", "int32", "float32", "float64"])
def test_colour_of_any_number_becomes_grey(kind):
    image = np.stack([board() // 2] * 3, axis=-1).astype(kind)
    np.testing.assert_allclose(read_source(image), image[:, :, 0], atol=1e-3)


def test_an_array_that_is_no_image_is_reported():
    for array in (np.ones((8, 8, 3), bool), np.ones((0, 8, 3)), np.ones((8, 8, 2)), np.ones(8)):
        with pytest.raises(ValueError, match="expected an image in grey or colour"):
            read_source(array)


def damage_size(path):
    cv2.imwrite(str(path), board(size=(240, 160)))


def damage_content(path):
    path.write_bytes(path.read_bytes()[:-40])


def damage_all(path):
    path.write_bytes(b"")


def damage_values(path):
    image = board().astype(np.float32)
    image[3, 4] = np.nan
    cv2.imwrite(str(path.with_suffix(".tif")), image)
    path.unlink()


@pytest.mark.parametrize(
    ("damage", "message"),
    [
        (damage_size, "1.png: found 240x160 pixels, expected 200x160 as in"),
        (damage_content, "1.png: not a readable image: damaged or truncated"),
        (damage_all, "1.png: not a readable image: the file is empty"),
        (damage_values, "1.tif: found NaN or infinite pixels"),
    ],
)
def test_an_image_that_will_not_do_is_named_with_its_camera(folder, damage, message):
    damage(folder / "cam2" / "1.png")
    with pytest.raises(ValueError, match=r"^camera cam2: ") as caught:
        observe(image_set(folder), TARGET)
    assert message in str(caught.value)
    assert "\n" not in str(caught.value)


def test_a_camera_that_never_sees_the_target_is_named():
    images = {"one": {"a": board()}, "other": {"a": np.full((160, 200), 90, np.uint8)}}
    with pytest.raises(ValueError, match="camera other: frame a: found no chessboard") as caught:
        observe(images, TARGET)
    assert "expected chessboard:5x4:1.0, which none of its 1 images shows" in str(caught.value)
    found = detections({"one": {"a": board(), "b": images["other"]["a"]}}, TARGET)
    assert list(found.reasons) == [("one", "b")]
    assert np.isnan(found.blur[0, 1])


def test_ambiguous_targets_are_refused_for_more_than_one_camera():
    target = parse_target("chessboard:6x4:1.0")
    with pytest.raises(ValueError, match="both even, looks the same turned by 180 degrees"):
        observe({"one": {"a": board()}, "other": {"a": board()}}, target)
    drawn, _ = target.drawing(16)
    image = cv2.GaussianBlur(np.pad(drawn, 8, constant_values=120), (0, 0), 0.8)
    assert len(observe({"one": {"a": image}}, target)) == 24


@pytest.mark.parametrize(
    ("images", "message"),
    [
        ({}, "images: found no cameras"),
        ({"left": {}}, "camera left: found no images"),
        ({"left": {"a": "absent.png"}}, "camera left: absent.png: cannot be read"),
        ({"left": {"a": np.zeros((4, 5, 6, 7))}}, "camera left: image: found shape"),
    ],
)
def test_missing_images_are_named(images, message):
    with pytest.raises(ValueError, match=message):
        observe(images, TARGET)


def test_films_of_other_formats_are_moments(tmp_path):
    frames = np.stack([board(2 * k) for k in range(3)])
    for name in ("left", "right"):
        np.save(tmp_path / f"{name}.npy", frames)
    images = image_set(tmp_path, every=2)
    assert images["left"] == {f"{k:06d}": VideoFrame(tmp_path / "left.npy", k) for k in (0, 2)}
    np.testing.assert_array_equal(read_source(images["right"]["000002"]), board(4))
    assert observe(images, TARGET, cache=tmp_path / "cache").counts().tolist() == [[20, 20]] * 2
    assert notes_of(images) == []
    (tmp_path / "cams").mkdir()
    for name in ("left", "right"):
        folder = tmp_path / "cams" / name
        folder.mkdir()
        head = struct.pack("<4h4i3h", 0, 0, -2, 0, 200, 160, 1, 3, 0, 1, 0)
        (folder / "B00001.im7").write_bytes(head.ljust(256, b"\0") + frames.tobytes())
    images = image_set(tmp_path / "cams")
    assert list(images["right"]) == ["000000", "000001", "000002"]
    np.testing.assert_array_equal(read_source(images["right"]["000001"]), board(2))
