"""Films of other programs' formats: read as those programs read them, and what goes wrong."""

import struct
import sys
from pathlib import Path

import numpy as np
import pytest
import tifffile
from film_files import FRAMES, NUMBERS, cine, nexus, photron, xarray_s_zarr, zarr_array

from rigs.recordings import FrameError, RawLayout, open_recording
from rigs.recordings.film_formats.image_sequence import ImageSequence

TIMES = np.arange(6) / 1000 - 0.25


def as_pycine(frames):
    """Stretch pixels from black to white, as pycine does."""
    return np.interp(frames, [64, 4064], [0, 4095]).astype(np.uint16)


@pytest.mark.parametrize("packing", [0, 256, 1024])
def test_phantom_films_are_what_pycine_reads(tmp_path, packing):
    raw, files = pytest.importorskip("pycine.raw"), pytest.importorskip("pycine.file")
    path, _ = cine(tmp_path, 16, packing, note=b"")  # pycine misreads notes
    film = open_recording(path)
    assert film.bit_depth == 12
    for index, frame in enumerate(raw.read_frames(path, start_frame=1)[0]):
        np.testing.assert_array_equal(as_pycine(film.read(index)), frame)
    theirs = files.read_header(path)["timestamp"] - (1_700_000_000 + 0.5)
    np.testing.assert_allclose(film.timestamps, theirs, atol=1e-6)  # they round whole seconds


def test_phantom_films_keep_rate_times_levels_and_crop(tmp_path):
    film = open_recording(cine(tmp_path, 16)[0])
    assert film.frame_rate == 1000
    np.testing.assert_allclose(film.timestamps, TIMES, atol=1e-9)
    levels, crop = film.notes
    assert "black is 64 and white 4064 of 4095" in levels
    assert "dark: 0.01563, saturation: 0.9924" in levels
    assert "column 128, row 64 of the sensor" in crop


def test_the_table_of_ten_bits_is_whole_and_rises(tmp_path):
    from rigs.recordings.film_formats.cine import _linear_codes

    codes = _linear_codes().astype(int)
    assert (codes[0], codes[64], codes[1014], codes[1015]) == (2, 64, 4064, 4095)
    assert (np.diff(codes) >= 0).all()


def test_photron_films_are_what_pymraw_reads(tmp_path):
    py_mraw = pytest.importorskip("pyMRAW")
    photron(tmp_path, 12)
    theirs, _ = py_mraw.load_video(str(tmp_path / "a.cihx"))
    film = open_recording(tmp_path / "a.cihx")
    np.testing.assert_array_equal([film.read(index) for index in range(6)], theirs)
    assert film.frame_rate == 2000
    np.testing.assert_allclose(film.timestamps, np.arange(-10, -4) / 2000)


def test_samples_of_davis_are_what_readim7_reads():
    readim7 = pytest.importorskip("readim7")
    from readim7 import core

    sample = Path(readim7.__file__).parent / "sample_files" / "1camera.im7"
    theirs = core.read_file(str(sample))["array"]
    film = open_recording(sample)
    assert film.image_size == (1376, 1024)
    np.testing.assert_array_equal([film.read(index) for index in range(2)], theirs)
    np.testing.assert_allclose(film.timestamps, 18.04084)
    assert "2 frames, of all cameras" in film.notes[0]


@pytest.mark.parametrize("make", [nexus, xarray_s_zarr])
def test_times_are_those_of_the_axis(tmp_path, make):
    np.testing.assert_allclose(open_recording(make(tmp_path)[0]).timestamps, np.arange(6) * 2e-4)


def test_arrays_are_found_where_they_are_the_only_ones(tmp_path):
    import h5py

    path = Path(str(nexus(tmp_path)[0]).partition(":")[0])
    np.testing.assert_array_equal(open_recording(path).read(2), FRAMES[2])
    with h5py.File(path, "a") as file:
        file["other"] = FRAMES
    with pytest.raises(ValueError, match=r"a\.nxs:/other, a\.nxs:/entry/data/data of shape"):
        open_recording(path)
    for name, message in (("entry/no", "found no 'no'"), ("entry/data", "found a group")):
        with pytest.raises(ValueError, match=message):
            open_recording(f"{path}:/{name}")


def test_data_outside_the_folder_are_refused(tmp_path):
    import h5py

    (tmp_path / "in").mkdir()
    with h5py.File(tmp_path / "secret.h5", "w") as file:
        file["data"] = FRAMES
    with h5py.File(tmp_path / "in" / "a.h5", "w") as file:
        file["link"] = h5py.ExternalLink("../secret.h5", "/data")
        layout = h5py.VirtualLayout(FRAMES.shape, "u2")
        layout[:] = h5py.VirtualSource("../secret.h5", "data", FRAMES.shape)
        file.create_virtual_dataset("virtual", layout)
        outside = [(str(tmp_path / "secret.h5"), 0, FRAMES.nbytes)]
        file.create_dataset("raw", FRAMES.shape, "u2", external=outside)
    for name in ("link", "virtual", "raw"):
        with pytest.raises(ValueError, match="expected them in the f"):
            open_recording(f"{tmp_path / 'in' / 'a.h5'}:/{name}")


def test_frames_that_were_never_written_are_not_black(tmp_path):
    import h5py

    with h5py.File(tmp_path / "a.h5", "w") as file:
        data = file.create_dataset("data", FRAMES.shape, "u2", chunks=(1, 20, 48))
        data[:4] = FRAMES[:4]
    path, _ = zarr_array(tmp_path)
    (path / "c" / "5" / "1" / "0").unlink()
    for film in (open_recording(tmp_path / "a.h5"), open_recording(path)):
        np.testing.assert_array_equal(film.read(3), FRAMES[3])
        with pytest.raises(FrameError, match="frame 5: found a part that was never written"):
            film.read(5)


@pytest.mark.parametrize(
    ("dtype", "order"),
    [("uint12", "little"), ("uint16", "big"), ("float32", "big"), ("int16", "little")],
)
def test_raw_films_are_read_by_their_description(tmp_path, dtype, order):
    from film_files import packed

    frames = NUMBERS.astype(dtype if dtype != "uint12" else "uint16")
    stored = frames.astype(frames.dtype.newbyteorder({"little": "<", "big": ">"}[order]))
    parts = [packed(one, 12) if dtype == "uint12" else one.tobytes() for one in stored]
    (tmp_path / "a.bin").write_bytes(b"header." + b"gap".join(parts))
    layout = RawLayout(48, 40, dtype, order, header_bytes=7, gap_bytes=3)
    film = open_recording(tmp_path / "a.bin", layout)
    assert film.n_frames == 6
    assert film.bit_depth == {"uint12": 12, "float32": None}.get(dtype, 16)
    for index in (5, 0, 3):
        np.testing.assert_array_equal(film.read(index), frames[index])
    with pytest.raises(ValueError, match=r"a\.bin: found \d+ bytes, expected 8 before frames"):
        open_recording(tmp_path / "a.bin", RawLayout(48, 40, dtype, order, 8, 3))


def damage(path, place, content):
    with open(path, "r+b") as file:
        file.seek(place)
        file.write(content)


def test_a_frame_that_cannot_be_decoded_is_named_and_others_are_read(tmp_path):
    path, frames = cine(tmp_path, 16)
    damage(path, path.stat().st_size - FRAMES[0].nbytes - 12, struct.pack("<I", 3))
    film = open_recording(path)
    np.testing.assert_array_equal(film.read(4), frames[4])
    with pytest.raises(FrameError) as caught:
        film.read(5)
    assert (caught.value.path, caught.value.frame) == (path, 5)
    assert str(caught.value).startswith(f"{path}: frame 5: ")


def test_a_film_that_ends_early_is_refused_at_once(tmp_path):
    path, _ = photron(tmp_path, 12)
    path.write_bytes(path.read_bytes()[:-1])
    with pytest.raises(ValueError, match=r"a\.mraw: found 17279 bytes, expected 17280"):
        open_recording(path)
    (tmp_path / "a.cihx").unlink()
    with pytest.raises(ValueError, match=r"found no a\.cihx or a\.cih beside it"):
        open_recording(path)


def test_pickles_in_arrays_are_not_loaded(tmp_path):
    np.save(tmp_path / "a.npy", np.array([[[{}]]], dtype=object), allow_pickle=True)
    with pytest.raises(ValueError, match=r"a\.npy: not a readable NumPy array"):
        open_recording(tmp_path / "a.npy")


def test_without_the_extra_the_message_says_what_to_type(tmp_path, monkeypatch):
    path, _ = nexus(tmp_path)
    monkeypatch.setitem(sys.modules, "h5py", None)
    with pytest.raises(ValueError, match=r"h5py, which .*: pip install 'flametomo\[films\]'"):
        open_recording(path)


@pytest.mark.parametrize(
    ("name", "codec"), [("a.mp4", "mpeg4"), ("a.avi", "mpeg4"), ("a.mpg", "mpeg1video")]
)
def test_pictures_that_depend_on_others_are_found_in_any_order(tmp_path, name, codec):
    import av

    with av.open(str(tmp_path / name), "w") as file:
        options = {
            "bf": "2",
            "g": "8",
            "qmin": "1",
            "qmax": "1",
        }  # pictures between others, and one in eight by itself
        stream = file.add_stream(codec, rate=25, width=64, height=48, options=options)
        for number in range(20):
            picture = av.VideoFrame.from_ndarray(
                np.full((48, 64), 20 + 10 * number, np.uint8), "gray"
            )
            picture.pts = number
            file.mux(stream.encode(picture.reformat(format="yuv420p")))
        file.mux(stream.encode())
    film = open_recording(tmp_path / name)
    assert film.n_frames == 20
    for index in (19, 0, 13, 14, 15, 3, 19):
        assert abs(film.read(index).mean() - (20 + 10 * index)) < 5  # nearer than the next picture
    times = np.arange(20) / 25 if name == "a.mp4" else None
    assert film.timestamps is None if times is None else np.allclose(film.timestamps, times)


def test_texts_that_lead_nowhere_are_refused_before_hdf5_never_ends(tmp_path):
    path = Path(str(nexus(tmp_path)[0]).partition(":")[0])
    content = path.read_bytes()
    place = content.index(b"GCOL") + 16  # the first text: number, references, reserved, size
    path.write_bytes(content[:place] + bytes(16) + content[place + 16 :])
    with pytest.raises(ValueError, match=rf"found a text at byte {place} of 0 bytes: damaged"):
        open_recording(path)


def test_files_of_another_full_scale_are_named(tmp_path):
    for name, frame in (("a", FRAMES[0]), ("b", (FRAMES[1] >> 8).astype(np.uint8))):
        tifffile.imwrite(tmp_path / f"{name}.tif", frame)
    film = ImageSequence(sorted(tmp_path.glob("*.tif")), tmp_path)
    assert film.read(0).shape == (40, 48)
    with pytest.raises(FrameError, match=r"full scale: found 255, expected 65535 as in a\.tif"):
        film.read(1)
