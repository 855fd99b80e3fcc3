"""Every format of recordings behind the one protocol."""

import os
import pickle
import struct
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor

import cv2
import numpy as np
import pytest
import tifffile
from film_files import (
    FILMS,
    FRAMES,
    folder_of_tiffs,
    lossless_video,
    tiff_stack,
)

from rigs.recordings import open_recording


@pytest.mark.parametrize("name", FILMS)
def test_frames_are_those_written_in_any_order_and_from_threads(tmp_path, name):
    path, frames = FILMS[name].make(tmp_path)
    film = open_recording(path)
    assert film.n_frames == 6
    assert film.image_size == (48, 40)
    tolerance = 2 if name == "lossless_video" else 0  # of its levels, black to white
    assert film.bit_depth == FILMS[name].bits
    for index in (0, 5, 2, 2, 3, 1):
        found = film.read(index)
        assert found.shape == (40, 48)
        assert found.dtype == frames.dtype
        np.testing.assert_allclose(found.astype(float), frames[index], atol=tolerance)
    with ThreadPoolExecutor(4) as pool:
        order = [4, 0, 3, 5, 1, 2] * 4
        for index, found in zip(order, pool.map(film.read, order), strict=True):
            np.testing.assert_allclose(found.astype(float), frames[index], atol=tolerance)


@pytest.mark.parametrize("name", FILMS)
def test_a_frame_that_is_not_there(tmp_path, name):
    film = open_recording(FILMS[name].make(tmp_path)[0])
    film = pickle.loads(pickle.dumps(film))  # a copy in another process
    for index in (-1, film.n_frames):
        with pytest.raises(IndexError, match=f"found frame {index}, expected 0 to 5"):
            film.read(index)


def test_what_a_file_says_of_time_and_light(tmp_path):
    film = open_recording(lossless_video(tmp_path)[0])
    assert film.frame_rate == 25
    assert film.timestamps is None
    (note,) = film.notes
    assert "8 bits" in note and "gamma" in note  # noqa: PT018
    assert open_recording(tiff_stack(tmp_path)[0]).notes == ()


def test_an_orientation_tag_is_noted(tmp_path):
    (tmp_path / "cam").mkdir()
    for number in range(2):
        tifffile.imwrite(
            tmp_path / "cam" / f"{number}.tif", FRAMES[0], photometric="minisblack",
            extratags=[(274, "H", 1, 3, True)],
        )  # fmt: skip
    (note,) = open_recording(tmp_path / "cam").notes
    assert "an orientation tag (3)" in note


def test_packed_bits_are_the_depth(tmp_path, write_packed):
    (tmp_path / "cam").mkdir()
    write_packed(tmp_path / "cam" / "0.tif", FRAMES[0] >> 4, 12)
    film = open_recording(tmp_path / "cam")
    assert film.bit_depth == 12
    np.testing.assert_array_equal(film.read(0), FRAMES[0] >> 4)


def test_frames_of_another_size_are_named(tmp_path):
    folder, _ = folder_of_tiffs(tmp_path)
    cv2.imwrite(str(folder / "9.tif"), FRAMES[0][:30])
    with pytest.raises(
        ValueError, match=r"9\.tif: frame 1: found 48 x 30 pixels, expected 48 x 40"
    ):
        open_recording(folder).read(1)
    with tifffile.TiffWriter(tmp_path / "a.tif") as file:
        file.write(FRAMES[0], photometric="minisblack")
        file.write(FRAMES[0][:30], photometric="minisblack")
    film = open_recording(tmp_path / "a.tif")
    with pytest.raises(ValueError, match=r"a\.tif: frame 1: found 48 x 30 pixels"):
        film.read(1)


def test_what_is_no_recording_is_refused(tmp_path):
    with pytest.raises(FileNotFoundError, match="no such recording"):
        open_recording(tmp_path / "absent.avi")
    with pytest.raises(ValueError, match="found no image, expected one file a frame"):
        open_recording(tmp_path)
    for name, content, message in (
        ("a.txt", b"text", r"found suffix '\.txt', expected a folder of images, or one of \.tif"),
        ("a.avi", b"text", "not a readable video"),
        ("a.mp4", b"\0\0\0\x18ftypmp42" + bytes(40), "not a readable video"),
        ("a.tif", b"text", "not a readable TIFF"),
        ("b.tif", b"II*\0" + struct.pack("<I", 8) + bytes(60), "b.tif: "),
    ):
        (tmp_path / name).write_bytes(content)
        with pytest.raises(ValueError, match=message) as caught:
            open_recording(tmp_path / name).read(0)
        assert "\n" not in str(caught.value)


def test_decoders_write_nothing_on_the_terminal(tmp_path):
    """In a process of its own: FFmpeg takes its level of logging when it is first used."""
    path, _ = lossless_video(tmp_path)
    content = path.read_bytes()
    path.write_bytes(content[: len(content) // 2])
    (tmp_path / "b.mp4").write_bytes(b"\0\0\0\x18ftypmp42" + bytes(40))
    code = """
import sys
from rigs.recordings import open_recording
for path in sys.argv[1:]:
    try:
        open_recording(path).n_frames
    except ValueError as error:
        print(error)
"""
    ended = subprocess.run(
        [sys.executable, "-c", code, path, tmp_path / "b.mp4"],
        capture_output=True, text=True, check=True,
        env=os.environ | {"PYTHONPATH": os.pathsep.join(sys.path)},
    )  # fmt: skip
    assert ended.stderr == ""
    assert len(ended.stdout.splitlines()) == 2


def test_raw_video_of_two_bytes_a_pixel_is_not_taken_for_colours(tmp_path):
    """An AVI has one name for colours of 5 bits and for the grey of 16 that cameras write."""
    import av

    with av.open(str(tmp_path / "a.avi"), "w") as file:
        stream = file.add_stream("rawvideo", rate=10)
        stream.width, stream.height, stream.pix_fmt = 16, 8, "gray16le"
        picture = av.VideoFrame.from_ndarray(np.full((8, 16), 4095, np.uint16), "gray16le")
        file.mux([*stream.encode(picture), *stream.encode()])
    with pytest.raises(ValueError, match=r"a\.avi: .*raw pixels of two bytes each.* raw: in scan"):
        open_recording(tmp_path / "a.avi")
