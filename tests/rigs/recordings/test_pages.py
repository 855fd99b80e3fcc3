"""TIFF files of several pages: a thumbnail or a mask beside the image, and what is none."""

import numpy as np
import pytest
import tifffile

from rigs.recordings import image_notes, image_size, read_image

IMAGE = np.random.default_rng(0).integers(0, 255, (64, 80), dtype=np.uint8)
SMALL = IMAGE[::8, ::8].copy()


def write(path, *pages):
    """Write pages of an image, its NewSubfileType and its number of pages inside."""
    with tifffile.TiffWriter(path) as file:
        for image, kind, inside in pages:
            file.write(
                image, subfiletype=kind, subifds=inside, metadata=None, photometric="minisblack"
            )


@pytest.mark.parametrize(
    "pages",
    [
        [(IMAGE, 0, 0), (SMALL, 1, 0)],
        [(SMALL, 1, 0), (IMAGE, 0, 0)],
        [(IMAGE, 0, 0), (IMAGE > 0, 4, 0)],  # a mask
        [(IMAGE, 0, 1), (SMALL, 1, 0)],  # a pyramid: inside the image's page
        [(SMALL, 1, 1), (IMAGE, 0, 0)],  # as in cameras' raw files: inside the thumbnail's
    ],
    ids=["thumbnail last", "thumbnail first", "mask", "pyramid", "raw"],
)
def test_pages_beside_the_image_are_known_by_their_tag(tmp_path, pages):
    write(tmp_path / "a.tif", *pages)
    np.testing.assert_allclose(read_image(tmp_path / "a.tif"), IMAGE / 255, rtol=1e-6)
    assert image_size(tmp_path / "a.tif") == (80, 64)
    assert not image_notes({"cam": [tmp_path / "a.tif"]})


def test_smaller_pages_without_a_tag_are_thumbnails_and_said_to_be(tmp_path):
    for pages in ([(IMAGE, 0, 0), (SMALL, 0, 0)], [(SMALL, 0, 0), (IMAGE, 0, 0)]):
        write(tmp_path / "a.tif", *pages)
        np.testing.assert_allclose(read_image(tmp_path / "a.tif"), IMAGE / 255, rtol=1e-6)
        (note,) = image_notes({"cam": [tmp_path / "a.tif"]})
        assert note.startswith("camera cam: the page of 80 x 64 pixels is the image")


@pytest.mark.parametrize(
    ("pages", "message"),
    [
        ([(IMAGE, 0, 0), (IMAGE, 0, 0)], "found more than one page"),
        ([(IMAGE, 0, 0), (IMAGE[:40, :60].copy(), 0, 0)], "found more than one page"),
        ([(IMAGE, 0, 0)] + 5 * [(SMALL, 0, 0)], "found more than one page"),
        ([(SMALL, 1, 0)], "found only thumbnails"),
    ],
)
def test_what_could_be_several_images_is_refused(tmp_path, pages, message):
    write(tmp_path / "a.tif", *pages)
    with pytest.raises(ValueError, match=rf"a\.tif: not a readable image: {message}"):
        read_image(tmp_path / "a.tif")
