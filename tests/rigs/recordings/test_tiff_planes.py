"""TIFF files of many pages: axes and lengths that files say, held against the pages there are."""

import struct

import numpy as np
import pytest
import tifffile

from rigs.recordings import image_size, is_film, open_recording
from tomo import scan_of_images

PLANES = np.random.default_rng(0).integers(0, 60000, (5, 2, 6, 8)).astype(np.uint16)
OME = {
    "axes": "TCYX", "Channel": {"Name": ["CH*", "OH*"]}
}  # fmt: skip


def ome(path, stack=PLANES, **metadata):
    tifffile.imwrite(path, stack, ome=True, photometric="minisblack", metadata=OME | metadata)


def imagej(path):
    tifffile.imwrite(path, PLANES, imagej=True, metadata={"axes": "TCYX"})


def shaped(path):
    tifffile.imwrite(path, PLANES, photometric="minisblack", metadata={"axes": "TCYX"})


def one_block(path):
    """Write as ImageJ does over 4 GB: one header, and the values of all planes in one piece."""
    said = "ImageJ=1.54f\nimages=10\nchannels=2\nframes=5\nhyperstack=true\n"
    pages = PLANES.reshape(-1, 6, 8)
    tifffile.imwrite(path, pages[0], description=said, metadata=None, byteorder=">")
    with open(path, "r+b") as file:
        with tifffile.TiffFile(path) as opened:
            file.seek(opened.pages[0].dataoffsets[0])
        file.write(pages.astype(">u2").tobytes())


def channels_first(path):
    """Write OME-XML in which every plane names its page, all of a channel first."""
    pages = np.moveaxis(PLANES, 1, 0)
    tifffile.imwrite(path, pages, photometric="minisblack", metadata=None, description="OME")
    places = "".join(
        f'<TiffData FirstT="{t}" FirstC="{c}" FirstZ="0" IFD="{5 * c + t}" PlaneCount="1"/>'
        for t in range(5)
        for c in range(2)
    )
    said = (
        '<?xml version="1.0"?><OME UUID="urn:a"><Image><Pixels DimensionOrder="XYZCT" SizeX="8" '
        f'SizeY="6" SizeZ="1" SizeC="2" SizeT="5">{places}</Pixels></Image></OME>'
    )
    tifffile.tiffcomment(path, said.encode())


@pytest.mark.parametrize("write", [ome, imagej, shaped, one_block, channels_first])
def test_channels_are_no_frames_and_one_is_asked_for(tmp_path, write):
    write(tmp_path / "a.tif")
    assert is_film(tmp_path / "a.tif")
    film = open_recording(tmp_path / "a.tif")
    assert film.n_frames == 5
    for frame, channel in ((0, 0), (3, 1), (4, 0)):
        found = film.read_channel(frame, str(channel))
        np.testing.assert_array_equal(found, PLANES[frame, channel])
    for channel in (None, "2", "r"):
        with pytest.raises(ValueError, match=r"a\.tif: .*expected 0 to 1, one of .*--channel 0"):
            film.read_channel(0, channel)


def test_channels_are_named_in_the_question(tmp_path):
    ome(tmp_path / "a.tif")
    with pytest.raises(ValueError, match=r"2 channels \(CH\*, OH\*\)"):
        open_recording(tmp_path / "a.tif").read(0)


def test_a_scan_takes_the_channel_of_its_corrections(tmp_path):
    import rigs

    rig = rigs.ring(2, distance=50.0, image_size=(8, 6), footprint=1.0)
    for name in rig.names:
        ome(tmp_path / f"{name}.tif")
    scan = scan_of_images(rig, tmp_path)
    assert len(scan.frames) == 5
    with pytest.raises(ValueError, match=r"cam00: channel: found none"):
        scan.images("1")
    for image in scan.of_channel("1").images("2"):
        np.testing.assert_array_equal(image, PLANES[2, 1] / np.float32(65535))


@pytest.mark.parametrize("colour", ["r", "g", "b"])
def test_pages_in_colour_give_the_colour_asked_for(tmp_path, colour):
    frames = np.random.default_rng(1).integers(0, 255, (3, 6, 8, 3)).astype(np.uint8)
    tifffile.imwrite(tmp_path / "a.tif", frames, photometric="rgb")
    film = open_recording(tmp_path / "a.tif")
    np.testing.assert_array_equal(
        film.read_channel(2, colour), frames[2, ..., "rgb".index(colour)]
    )


def test_grey_frames_have_no_channel_to_choose(tmp_path):
    tifffile.imwrite(tmp_path / "a.tif", PLANES[:, 0], photometric="minisblack")
    with pytest.raises(ValueError, match="frame 1: channel: found 'g', expected none"):
        open_recording(tmp_path / "a.tif").read_channel(1, "g")


def test_an_axis_that_the_writer_had_no_name_for_is_time_and_a_note_says_so(tmp_path):
    tifffile.imwrite(tmp_path / "a.tif", PLANES[:, 0], ome=True, photometric="minisblack")
    film = open_recording(tmp_path / "a.tif")
    assert film.n_frames == 5
    assert "taken for moments" in film.notes[0]


@pytest.mark.parametrize(
    ("metadata", "message"),
    [
        ({"ome": True, "metadata": {"axes": "TZYX"}}, r"T 5, .*Z 2.* store one of T and Z alone"),
        ({"imagej": True, "metadata": {"axes": "TZYX"}}, "store one of T and Z alone"),
        ({"metadata": {}}, "store one of Q and Q alone"),
    ],
)
def test_frames_in_more_than_one_axis_are_refused(tmp_path, metadata, message):
    tifffile.imwrite(tmp_path / "a.tif", PLANES, photometric="minisblack", **metadata)
    with pytest.raises(ValueError, match=rf"a\.tif: .*{message}"):
        open_recording(tmp_path / "a.tif")


def test_planes_in_other_files_are_not_missed_in_silence(tmp_path):
    channels_first(tmp_path / "a.tif")
    said = tifffile.tiffcomment(tmp_path / "a.tif")
    elsewhere = said.replace(
        'IFD="9" PlaneCount="1"/>', 'IFD="9"><UUID FileName="b.tif">urn:b</UUID></TiffData>'
    )
    assert elsewhere != said
    tifffile.tiffcomment(tmp_path / "a.tif", elsewhere.encode())
    with pytest.raises(ValueError, match=r"says 10 planes .* of which 9 are in this file"):
        open_recording(tmp_path / "a.tif")


def separate(path):
    """Write pages one after the other, each header behind its values, without a description."""
    with tifffile.TiffWriter(path) as file:
        for page in PLANES[:, 0]:
            file.write(page, metadata=None, photometric="minisblack", contiguous=False)


def contiguous(path):
    tifffile.imwrite(path, PLANES[:, 0], photometric="minisblack")


@pytest.mark.parametrize("write", [separate, contiguous])
@pytest.mark.parametrize("kept", [0.4, 0.9])
def test_a_stack_cut_short_names_the_file_and_the_page(tmp_path, write, kept):
    write(tmp_path / "a.tif")
    content = (tmp_path / "a.tif").read_bytes()
    (tmp_path / "a.tif").write_bytes(content[: int(kept * len(content))])
    assert is_film(tmp_path / "a.tif")
    with pytest.raises(ValueError, match=r"a\.tif: .*page [0-4]: .*truncated"):
        open_recording(tmp_path / "a.tif")


def test_a_cut_that_leaves_one_whole_page_is_no_still_image(tmp_path):
    contiguous(tmp_path / "a.tif")
    (tmp_path / "a.tif").write_bytes((tmp_path / "a.tif").read_bytes()[:500])
    with pytest.raises(ValueError, match=r"a\.tif: .*page 1: its header at byte \d+ is not in"):
        image_size(tmp_path / "a.tif")


@pytest.mark.parametrize("write", [ome, imagej, shaped, channels_first])
def test_fewer_pages_than_the_file_says(tmp_path, write):
    """The chain of pages ends as it should, two pages early."""
    write(tmp_path / "a.tif")
    with tifffile.TiffFile(tmp_path / "a.tif") as file:
        if write is imagej:
            assert len(file.pages) == 10
        tags = file.pages[7]
        end = tags.offset + 2 + 12 * len(tags.tags)
        order = file.byteorder
    with open(tmp_path / "a.tif", "r+b") as file:
        file.seek(end)
        file.write(struct.pack(f"{order}I", 0))
    with pytest.raises(ValueError, match=r"a\.tif: .*page 8: missing: .* says 10 planes"):
        open_recording(tmp_path / "a.tif")


def test_pages_in_a_circle(tmp_path):
    separate(tmp_path / "a.tif")
    with tifffile.TiffFile(tmp_path / "a.tif") as file:
        last, first = file.pages[4], file.pages[1].offset
        end = last.offset + 2 + 12 * len(last.tags)
    with open(tmp_path / "a.tif", "r+b") as file:
        file.seek(end)
        file.write(struct.pack("<I", first))
    with pytest.raises(ValueError, match="page 5: the header before it leads to page 1"):
        open_recording(tmp_path / "a.tif")
