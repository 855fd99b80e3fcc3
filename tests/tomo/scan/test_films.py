"""Films as input; the files are written by tifffile."""

import pickle

import h5py
import numpy as np
import pytest
import tifffile
import yaml

import rigs
from rigs.recordings.film_formats.tiff_stack import TiffStack
from tomo import load_scan, scan_of_images


@pytest.fixture
def films(tmp_path):
    """Return a folder of a rig and two films of seven frames, and the frames."""
    rig = rigs.ring(2, distance=50.0, image_size=(5, 4), footprint=1.0)
    rigs.save_rig(rig, tmp_path / "rig.yaml")
    rng = np.random.default_rng(0)
    frames = {}
    for name in rig.names:
        frames[name] = rng.integers(0, 60000, (7, 4, 5)).astype(np.uint16)
        tifffile.imwrite(tmp_path / f"{name}.tif", frames[name], photometric="minisblack")
    return tmp_path, frames


RAW = {"width": 5, "height": 4, "dtype": "uint8"}


def write_scan(folder, **content):
    head = {"format": "emission-scan", "version": 1, "rig": "rig.yaml"}
    (folder / "scan.yaml").write_text(yaml.safe_dump(head | content))
    return folder


def test_pages_are_frames(films):
    folder, frames = films
    scan = scan_of_images(folder / "rig.yaml", folder)
    assert scan.frame_names == tuple("0123456")
    for number in (0, 6, 3):
        for name, image in zip(scan.rig.names, scan.images(str(number)), strict=True):
            np.testing.assert_array_equal(image, frames[name][number] / np.float32(65535))
    assert scan.holds_integers()


def test_scan_files_say_where_films_begin_and_which_camera_is_late(films):
    folder, frames = films
    write_scan(
        folder,
        films={"cam00": {"path": "cam00.tif", "first": 1, "step": 2},
               "cam01": {"path": "cam01.tif", "first": 1, "step": 2, "offset": 1}},
        frame_rate=500,
    )  # fmt: skip
    scan = load_scan(folder)
    assert scan.frame_rate == 500
    assert scan.frame_names == ("0", "1", "2", "3")
    first, second = scan.images("2")
    np.testing.assert_array_equal(first, frames["cam00"][5] / np.float32(65535))
    np.testing.assert_array_equal(second, frames["cam01"][4] / np.float32(65535))


def test_frames_that_a_late_camera_lacks_are_named_when_read(films):
    folder, _ = films
    write_scan(folder, films={"cam00": "cam00.tif", "cam01": {"path": "cam01.tif", "offset": 3}})
    scan = load_scan(folder)
    assert len(scan.frames) == 10
    with pytest.raises(ValueError, match="frame '2': camera cam01: found no image"):
        scan.images("2")
    with pytest.raises(ValueError, match="frame '8': camera cam00: found no image"):
        scan.images("8")
    assert len(scan.images("4")) == 2


def test_one_page_at_a_time_is_read(films, monkeypatch):
    folder, _ = films
    read = []
    monkeypatch.setattr(
        TiffStack, "read", lambda self, place: read.append(place) or np.zeros((4, 5))
    )
    scan = scan_of_images(folder / "rig.yaml", folder)
    assert not read
    scan.images("5")
    assert read == [5, 5]


@pytest.mark.parametrize(
    ("films_field", "parts"),
    [
        ({"cam00": "cam00.tif", "cam09": "cam01.tif"}, ["films", "cam09"]),
        ({"cam00": "cam00.tif", "cam01": "none.tif"}, ["none.tif", "cam01", "no such film"]),
        ({"cam00": "../cam00.tif"}, ["films: camera cam00", "inside the scan folder"]),
        ({"cam00": {"path": "cam00.tif", "first": -1}}, ["films.cam00", "0 or more"]),
        ({"cam00": {"path": "cam00.tif", "step": 0}}, ["films.cam00", "1 or more"]),
        ({"cam00": {"path": "cam00.tif", "speed": 2}}, ["films.cam00", "unknown field"]),
        ({"cam00": {"first": 2}}, ["films.cam00", "missing"]),
        ({"cam00": "cam00.tif", "cam01": {"path": "cam01.tif", "offset": 9}}, ["in all films"]),
        ({}, ["frames: missing"]),
        *(
            ({"cam00": {"path": "cam00.bin", "raw": raw}, "cam01": "cam01.tif"}, parts)
            for raw, parts in (
                ({"width": 5, "height": 4}, ["films.cam00", "dtype", "missing"]),
                (RAW | {"height": 0}, ["films.cam00", "height", "1 or more"]),
                (RAW | {"dtype": "uint11"}, ["films.cam00", "dtype", "uint12"]),
                (RAW | {"gap": 1}, ["films.cam00", "gap", "unknown"]),
                (RAW | {"width": 50, "height": 40}, ["cam00.bin", "found 33 bytes"]),
            )
        ),
    ],
)
def test_bad_films_are_refused_in_one_line(films, films_field, parts):
    folder, _ = films
    (folder / "cam00.bin").write_bytes(bytes(33))
    write_scan(folder, films=films_field)
    with pytest.raises((ValueError, FileNotFoundError)) as caught:
        load_scan(folder)
    for part in parts:
        assert part in str(caught.value)
    assert "\n" not in str(caught.value)


def test_a_damaged_page_is_named(films):
    folder, frames = films
    path = folder / "cam01.tif"
    tifffile.imwrite(path, frames["cam01"], compression="zlib", photometric="minisblack")
    with tifffile.TiffFile(path) as file:
        place = file.pages.get(6).dataoffsets[0]
    content = path.read_bytes()
    path.write_bytes(content[:place] + bytes(20) + content[place + 20 :])
    scan = scan_of_images(folder / "rig.yaml", folder)
    assert len(scan.images("5")) == 2
    with pytest.raises(ValueError, match=r"cam01\.tif: frame 6") as caught:
        scan.images("6")
    assert "\n" not in str(caught.value)


def test_films_of_another_size_are_refused_by_name(films):
    folder, _ = films
    tifffile.imwrite(
        folder / "cam01.tif", np.zeros((7, 3, 3), np.uint16), photometric="minisblack"
    )
    scan = scan_of_images(folder / "rig.yaml", folder)
    with pytest.raises(ValueError, match=r"cam01\.tif: frame 0: camera cam01: .* 3 x 3 pixels"):
        scan.images("0")


def test_films_of_other_formats_are_read_alike_and_in_other_processes(films):
    folder, frames = films
    packed = [
        np.packbits((one.reshape(-1, 1) >> np.arange(11, -1, -1) & 1).astype(np.uint8)).tobytes()
        for one in frames["cam00"] >> 4
    ]
    (folder / "left.bin").write_bytes(b"head" + b"".join(packed))
    with h5py.File(folder / "right.h5", "w") as file:
        file["entry/data"] = frames["cam01"].astype(">u2")
    raw = {"width": 5, "height": 4, "dtype": "uint12", "header_bytes": 4}
    entries = {"cam00": {"path": "left.bin", "raw": raw}, "cam01": "right.h5:/entry/data"}
    write_scan(folder, films=entries)
    scan = pickle.loads(pickle.dumps(load_scan(folder)))
    left, right = scan.images("6")
    np.testing.assert_array_equal(left, (frames["cam00"][6] >> 4) / np.float32(4095))
    np.testing.assert_array_equal(right, frames["cam01"][6] / np.float32(65535))
    assert scan.notes == ()


def nexus(path, frames, times):
    with h5py.File(path, "w") as file:
        data = file.create_group("entry/data")
        data.attrs["axes"] = ["time", ".", "."]
        data["data"], data["time"] = frames, np.asarray(times, float)
        data["time"].attrs["units"] = "ms"


def test_times_that_disagree_are_warned_of_with_the_offset_that_fits(films):
    folder, frames = films
    late = {"path": "late.h5", "first": 2, "step": 2, "offset": 1}
    said = {3: ["cam01", "2 frames late", "offset: 3 ", "place of 1"], 1: None,
            0: ["cam01", "1 frame early", "offset: 0 "]}  # fmt: skip
    for lateness, expected in said.items():
        nexus(folder / "late.h5", frames["cam01"], 2.0 * (np.arange(7) + lateness))
        nexus(folder / "first.h5", frames["cam00"], 2.0 * np.arange(7) + 0.3)
        entries = {"cam00": {"path": "first.h5", "first": 2, "step": 2}, "cam01": late}
        write_scan(folder, films=entries)
        notes = [line for line in load_scan(folder).notes if "timestamps" in line]
        assert len(notes) == (expected is not None)
        assert all(part in notes[0] for part in expected or ())


def test_lost_frames_and_other_lengths_are_warned_of(films):
    folder, frames = films
    nexus(folder / "a.h5", frames["cam00"], np.delete(np.arange(8), 5))
    nexus(folder / "b.h5", frames["cam01"][:6], np.arange(6))
    write_scan(folder, films={"cam00": "a.h5", "cam01": "b.h5"})
    lengths, times = load_scan(folder).notes
    assert "found 7 (cam00), 6 (cam01) frames" in lengths
    assert "from frame 5 on: frames were lost" in times


def test_the_frame_rate_is_that_of_the_films_where_they_agree(films):
    folder, _ = films
    for name, rate in (("cam00", 100), ("cam01", 100), ("cam02", 200)):
        changes = {"Record Rate(fps)": str(rate)}
        text = "Total Frame : 3\nImage Width : 5\nImage Height : 4\nColor Bit : 8\n"
        text += "EffectiveBit Depth : 8\n" + "".join(f"{k} : {v}\n" for k, v in changes.items())
        (folder / f"{name}.cih").write_text(text)
        (folder / f"{name}.mraw").write_bytes(bytes(60))
    write_scan(folder, films={"cam00": "cam00.cih", "cam01": {"path": "cam01.mraw", "step": 1}})
    assert load_scan(folder).frame_rate == 100
    write_scan(folder, films={"cam00": "cam00.mraw", "cam01": "cam02.mraw"})
    scan = load_scan(folder)
    assert scan.frame_rate is None
    assert "found 100 (cam00), 200 (cam01) frames a second" in scan.notes[0]
    for path in folder.glob("*.tif"):
        path.unlink()
    assert scan_of_images(folder / "rig.yaml", folder).frame_rate == 100  # by the cameras' names


def test_a_mosaic_needs_the_order_of_its_colours(films):
    folder, frames = films
    for name, pages in frames.items():
        with tifffile.TiffWriter(folder / f"{name}.tif") as file:
            for page in pages:
                file.write(page, photometric="cfa", metadata=None)
    scan = scan_of_images(folder / "rig.yaml", folder)
    with pytest.raises(ValueError, match="found a mosaic of colour filters"):
        scan.images("0")
    colour = scan.of_channel("g", "RGGB").images("0")[0]
    np.testing.assert_array_equal(colour, frames["cam00"][0, :4:2, 1:4:2] / np.float32(65535))


def test_signed_integers_have_one_full_scale_in_films_and_stills(films):
    folder, frames = films
    signed = {name: (one // 2).astype(np.int16) for name, one in frames.items()}
    for name, one in signed.items():
        tifffile.imwrite(folder / f"{name}.tif", one, photometric="minisblack")
        tifffile.imwrite(folder / f"{name}_dark.tif", one[0], photometric="minisblack")
    dark = {name: f"{name}_dark.tif" for name in signed}
    write_scan(folder, films={n: f"{n}.tif" for n in signed}, corrections={"dark": dark})
    scan = load_scan(folder)
    assert not np.any(scan.images("0"))
    expected = (signed["cam00"][3].astype(float) - signed["cam00"][0]) / 32767
    np.testing.assert_allclose(scan.images("3")[0], expected, atol=1e-7)
